"""The same as `pecgrasp fake-robot`."""

from pecgrasp.cli import main

if __name__ == "__main__":
    main("fake-robot")
