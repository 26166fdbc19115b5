"""The same as `pecgrasp compare`."""

from pecgrasp.cli import main

if __name__ == "__main__":
    main("compare")
