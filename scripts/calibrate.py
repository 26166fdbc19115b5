"""The same as `pecgrasp calibrate`."""

from pecgrasp.cli import main

if __name__ == "__main__":
    main("calibrate")
