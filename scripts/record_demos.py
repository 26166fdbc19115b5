"""The same as `pecgrasp record-demos`."""

from pecgrasp.cli import main

if __name__ == "__main__":
    main("record-demos")
