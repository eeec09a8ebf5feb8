"""The MarsExplorer playground: server, storage and command."""
