"""The same as `pecgrasp export-onnx`."""

from pecgrasp.cli import main

if __name__ == "__main__":
    main("export-onnx")
