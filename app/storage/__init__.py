"""The database and its files: opening, migrations, the tables of play and of studies, the chain, exports, merging and erasure.

This package and the release writer are the only ones that speak SQL; others call `Store`, `Reader`, `StudyStore` and the
functions of `study_reader`, and get rows as dataclasses or dictionaries by column.
"""
