"""The same as `pecgrasp benchmark`."""

from pecgrasp.cli import main

if __name__ == "__main__":
    main("benchmark")
