"""The same as `pecgrasp generate-grasps`."""

from pecgrasp.cli import main

if __name__ == "__main__":
    main("generate-grasps")
