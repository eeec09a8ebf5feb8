"""The figures of the paper, drawn and tabulated from result files alone."""
