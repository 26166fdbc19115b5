"""The same as `pecgrasp transfer`."""

from pecgrasp.cli import main

if __name__ == "__main__":
    main("transfer")
