"""The figures of the paper, drawn and tabulated only from result files."""
