"""Published studies: signed bundles of tables and documents, written and read.

`build` writes a bundle and `bundle` verifies and imports one; the other modules are its parts.
"""
