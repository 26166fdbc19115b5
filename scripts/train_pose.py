"""The same as `pecgrasp train-pose`."""

from pecgrasp.cli import main

if __name__ == "__main__":
    main("train-pose")
