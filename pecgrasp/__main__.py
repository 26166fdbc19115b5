"""`python -m pecgrasp` is `pecgrasp`."""

from pecgrasp.cli import main

if __name__ == "__main__":
    main()
