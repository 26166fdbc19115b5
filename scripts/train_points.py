"""The same as `pecgrasp train-points`."""

from pecgrasp.cli import main

if __name__ == "__main__":
    main("train-points")
