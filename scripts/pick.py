"""The same as `pecgrasp pick`."""

from pecgrasp.cli import main

if __name__ == "__main__":
    main("pick")
