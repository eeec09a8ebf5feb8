"""MarsExplorer on the playground: all that knows its grid."""
