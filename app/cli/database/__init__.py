"""Commands about what a server recorded: export, verify, merge, and forget a participant."""
