"""The formats of policy files."""

NETWORK_FORMAT = "marsexplorer-network-3"
PRICED_NETWORK_FORMAT = "marsexplorer-policy-1"
"""Of networks that see prices; not a newer form of NETWORK_FORMAT, whose files are given what they were trained on."""
PAPER_FORMAT = "marsexplorer-paper-2"
PAPER_NETWORK_FORMAT = "marsexplorer-paper-3"
"""Of the paper's four algorithms; not a newer form of PAPER_FORMAT, whose files stay as they are."""
