"""The same as `pecgrasp strangers`."""

from pecgrasp.cli import main

if __name__ == "__main__":
    main("strangers")
