"""`python -m humanplay.cli` is the command `marsexplorer`."""

from humanplay.cli.main import main

main()
