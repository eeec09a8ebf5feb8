"""The command line: `main` is the command `marsexplorer`, and each of its commands NAME is the object NAME in NAME.py.

A command's module is imported when the command is called, and imports what is heavy inside its functions, so that help is fast.
"""
