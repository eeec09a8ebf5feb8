"""The database: its schema, the tables of play and of studies, and all SQL.

That includes the chain, exports, backups, merging and erasure. This package and the release writer
are the only ones that speak SQL; others call `Store`, `Reader`, `StudyStore` and the functions of
`studies`, and get rows as a `Trial`, other dataclasses or dictionaries by column.
"""
