"""The same as `pecgrasp evaluate-points`."""

from pecgrasp.cli import main

if __name__ == "__main__":
    main("evaluate-points")
