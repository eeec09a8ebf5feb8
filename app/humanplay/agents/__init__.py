"""Agents on instances that stay secret until an evaluation closes, with signed receipts; a room of
its own.

Only the wiring of the server and the table of commands know it: whoever does not evaluate agents
need not read it.
"""
