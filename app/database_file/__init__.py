"""The database as a file, and the threads that write and read it.

Below `app.storage`, which opens these files with SQLite. Nothing here opens and closes a database that SQLite has open in this
process: that would drop SQLite's locks.
"""
