"""Run `python -m app.coverage`."""

from app.coverage.intervals import main

if __name__ == "__main__":
    main()
