"""The same as `pecgrasp train-segmenter`."""

from pecgrasp.cli import main

if __name__ == "__main__":
    main("train-segmenter")
