"""The same as `pecgrasp train-bc`."""

from pecgrasp.cli import main

if __name__ == "__main__":
    main("train-bc")
