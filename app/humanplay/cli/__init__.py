"""The command line: `main` is the command `marsexplorer`, `console` and `commands` are what its commands share.

Each command is the object of its name in a module of that name, in the folder of what it is about: study, training, release,
database. The table is in `commands`. A command's module is imported when the command is called, and imports what is heavy
inside its functions, so that help is fast.
"""
