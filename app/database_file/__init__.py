"""The database as a file among files: who holds it, whether it still stands where it was opened, and what it held last.

Below `app.storage`, which opens these files with SQLite. Nothing here opens and closes a database that SQLite has open in this
process: that would drop SQLite's locks.
"""
