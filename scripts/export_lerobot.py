"""The same as `pecgrasp export-lerobot`."""

from pecgrasp.cli import main

if __name__ == "__main__":
    main("export-lerobot")
