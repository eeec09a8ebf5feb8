"""`python -m app.cli` is the command `marsexplorer`."""

from app.cli.main import main

main()
