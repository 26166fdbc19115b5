"""The same as `pecgrasp ablate`."""

from pecgrasp.cli import main

if __name__ == "__main__":
    main("ablate")
