"""Agents on instances that stay secret until an evaluation closes, with receipts.

Only the wiring of the server and the table of commands know this package: if you do not evaluate
agents you need not read it.
"""
