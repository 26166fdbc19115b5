"""HTML reports: a package's own template in the common shell, and what the templates of all reports are given."""

from __future__ import annotations

import base64
import io
from dataclasses import dataclass
from importlib.resources import files
from typing import Any

import numpy as np
from PIL import Image

from grasping.viewer.html import page, templates
from pec.metrics.proportions import wilson_interval


@dataclass(frozen=True)
class Tile:
    """A large figure and the lines of text below it."""

    figure: str
    lines: tuple[str, ...] = ()


@dataclass(frozen=True)
class Share:
    """count of n cases, with Wilson's 95 % interval; all in %."""

    count: int
    n: int

    @property
    def percent(self) -> float:
        return 100 * self.count / self.n

    @property
    def low(self) -> float:
        return 100 * wilson_interval(self.count, self.n)[0]

    @property
    def high(self) -> float:
        return 100 * wilson_interval(self.count, self.n)[1]


def report_page(package: str, name: str, title: str, **values: Any) -> str:
    """A self-contained HTML document: `templates/NAME.html` of a package, with its NAME.css where there is one.

    values: what the template is given besides the title. It may import the macros of "macros.html".
    """
    own = files(package) / "templates" / f"{name}.css"
    style = (files("pecgrasp_env.common") / "report.css").read_text(encoding="utf-8")
    style += own.read_text(encoding="utf-8") if own.is_file() else ""
    template = templates(package, "pecgrasp_env.common").get_template(f"{name}.html")
    return page(title, template.render(title=title, **values), style=style)


def data_uri(content: bytes, kind: str) -> str:
    """An image file's content as an address. kind: "png", "jpeg", "webp"."""
    return f"data:image/{kind};base64,{base64.b64encode(content).decode()}"


def jpeg_uri(image: np.ndarray) -> str:
    """(h, w, 3) uint8 as the address of a JPEG."""
    buffer = io.BytesIO()
    Image.fromarray(np.asarray(image, dtype=np.uint8)).save(buffer, "JPEG", quality=85)
    return data_uri(buffer.getvalue(), "jpeg")
