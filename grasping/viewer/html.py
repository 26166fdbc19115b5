"""The shell of a page with figures, one HTML file that loads nothing from elsewhere, and the templates of its parts.

Jinja2 is imported where a page is written, not with this module.
"""

from __future__ import annotations

from functools import cache
from importlib.resources import files
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from jinja2 import Environment


@cache
def templates(*packages: str) -> Environment:
    """The templates in the folders `templates` of `packages`, the first that has a name; what they print is escaped.

    Filters: `words` writes a name with spaces for underscores, `tojson` JSON that may stand inside a <script>.
    """
    from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined

    loader = ChoiceLoader([PackageLoader(package, "templates") for package in packages])
    environment = Environment(
        loader=loader, autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    environment.filters["words"] = lambda name: str(name).replace("_", " ")
    environment.policies["json.dumps_kwargs"] = {"separators": (",", ":"), "allow_nan": False}
    return environment


def page(title: str, body: str, *, style: str = "") -> str:
    """A whole self-contained HTML document. title: plain text; body: HTML; style: further CSS."""
    here = files("grasping.viewer") / "static"
    styles = "\n".join((here / name).read_text(encoding="utf-8") for name in ("page.css", "viewer.css"))
    scripts = "\n".join((here / name).read_text(encoding="utf-8") for name in ("raster.js", "viewer.js"))
    shell = templates("grasping.viewer").get_template("page.html")
    return shell.render(title=title, body=body, styles=styles, scripts=scripts, style=style)
