"""The same as `pecgrasp evaluate-dual`."""

from pecgrasp.cli import main

if __name__ == "__main__":
    main("evaluate-dual")
