"""The database: its schema, the tables of play, of studies and of operators, the chain, exports, backups, merging and erasure.

This package and the release writer are the only ones that speak SQL; others call `Store`, `Reader`, `StudyStore` and the
functions of `study_reader`, and get rows as dataclasses or dictionaries by column.
"""
