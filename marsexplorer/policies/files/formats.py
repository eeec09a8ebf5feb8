"""The formats of policy files."""

NETWORK_FORMAT = "marsexplorer-network-3"
PRICED_NETWORK_FORMAT = "marsexplorer-policy-1"
"""Of networks that see prices; not a newer form of NETWORK_FORMAT, whose files are given what they were trained on."""
