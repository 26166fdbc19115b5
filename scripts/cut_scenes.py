"""The same as `pecgrasp cut-scenes`."""

from pecgrasp.cli import main

if __name__ == "__main__":
    main("cut-scenes")
