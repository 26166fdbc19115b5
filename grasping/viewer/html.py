"""The shell of a page with figures: one HTML file that loads nothing from elsewhere."""

from __future__ import annotations

import html
import json
from importlib.resources import files


def assets() -> str:
    """The style and the script that all figures of a page share: once, in its head."""
    here = files("grasping.viewer") / "static"
    styles = "\n".join((here / name).read_text(encoding="utf-8") for name in ("page.css", "viewer.css"))
    scripts = "\n".join((here / name).read_text(encoding="utf-8") for name in ("raster.js", "viewer.js"))
    return f"<style>\n{styles}</style>\n<script>\n{scripts}</script>"


def page(title: str, body: str, *, style: str = "") -> str:
    """A whole self-contained HTML document. title: plain text; body: HTML; style: further CSS."""
    extra = f"<style>\n{style}</style>" if style else ""
    # The policy makes the browser itself refuse whatever is not in the file or beside it.
    policy = (
        "default-src 'none'; style-src 'unsafe-inline'; script-src 'unsafe-inline'; "
        "img-src data:; media-src 'self' file:"
    )
    return (
        f'<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f'<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f'<meta http-equiv="Content-Security-Policy" content="{policy}">\n'
        f'<link rel="icon" href="data:,">\n<title>{html.escape(title)}</title>\n{assets()}\n{extra}\n</head>\n'
        f"<body>\n{body}\n</body>\n</html>\n"
    )


def script_json(data: object) -> str:
    """JSON that may stand inside a <script>: no character of it can end the element."""
    text = json.dumps(data, separators=(",", ":"), allow_nan=False)
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")
