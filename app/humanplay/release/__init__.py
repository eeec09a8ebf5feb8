"""Published studies: a study is written as a signed bundle of tables and documents, and a bundle is
verified and imported.

`build` writes a bundle and `bundle` reads one; the other modules are its parts.
"""
