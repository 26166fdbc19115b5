"""The same as `pecgrasp plan`."""

from pecgrasp.cli import main

if __name__ == "__main__":
    main("plan")
