"""The same as `pecgrasp evaluate-pose`."""

from pecgrasp.cli import main

if __name__ == "__main__":
    main("evaluate-pose")
