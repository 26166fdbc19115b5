"""The same as `pecgrasp train`."""

from pecgrasp.cli import main

if __name__ == "__main__":
    main("train")
