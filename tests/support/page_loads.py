"""The ids of every batch of input events, of one page load in one tab."""

from humanplay.db.input_events import PageLoad

LOAD = {"page_load": "a-page-load", "tab": "a-browsers-tab"}
"""As a message says them."""
STORED_LOAD = PageLoad(LOAD["page_load"], LOAD["tab"])
"""As `add_input_events` takes them."""
