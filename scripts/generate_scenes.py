"""The same as `pecgrasp generate-scenes`."""

from pecgrasp.cli import main

if __name__ == "__main__":
    main("generate-scenes")
