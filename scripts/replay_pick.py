"""The same as `pecgrasp replay-pick`."""

from pecgrasp.cli import main

if __name__ == "__main__":
    main("replay-pick")
