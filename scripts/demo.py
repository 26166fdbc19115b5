"""The same as `pecgrasp demo`."""

from pecgrasp.cli import main

if __name__ == "__main__":
    main("demo")
