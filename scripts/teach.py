"""The same as `pecgrasp teach`."""

from pecgrasp.cli import main

if __name__ == "__main__":
    main("teach")
