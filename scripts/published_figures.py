"""The same as `pecgrasp published-figures`."""

from pecgrasp.cli import main

if __name__ == "__main__":
    main("published-figures")
