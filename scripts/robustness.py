"""The same as `pecgrasp robustness`."""

from pecgrasp.cli import main

if __name__ == "__main__":
    main("robustness")
