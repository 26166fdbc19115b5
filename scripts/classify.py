"""The same as `pecgrasp classify`."""

from pecgrasp.cli import main

if __name__ == "__main__":
    main("classify")
