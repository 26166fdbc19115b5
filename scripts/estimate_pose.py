"""The same as `pecgrasp estimate-pose`."""

from pecgrasp.cli import main

if __name__ == "__main__":
    main("estimate-pose")
