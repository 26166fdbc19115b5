"""The same as `pecgrasp try-planners`."""

from pecgrasp.cli import main

if __name__ == "__main__":
    main("try-planners")
