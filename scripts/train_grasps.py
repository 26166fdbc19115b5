"""The same as `pecgrasp train-grasps`."""

from pecgrasp.cli import main

if __name__ == "__main__":
    main("train-grasps")
