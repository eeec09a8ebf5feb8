"""`python -m humanplay.cli` is the command `humanplay`."""

from humanplay.cli.main import main

main()
