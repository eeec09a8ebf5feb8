"""`python -m humanplay.tasks.mars.cli` is the command `marsexplorer`."""

from humanplay.tasks.mars.cli import main

main()
