"""The same as `pecgrasp contact-sheet`."""

from pecgrasp.cli import main

if __name__ == "__main__":
    main("contact-sheet")
