"""A chart as SVG inside a page, and as SVG and PNG files."""

from __future__ import annotations

import io
import re
import xml.etree.ElementTree as ElementTree
from typing import TYPE_CHECKING

from pec.experiments.charts import COLOURS, TIP

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["inline_svg", "png", "standalone_svg"]

_SVG, _LINK = "{http://www.w3.org/2000/svg}", "{http://www.w3.org/1999/xlink}href"
_NO_METADATA = {"Date": None, "Creator": None, "Format": None, "Type": None}


def inline_svg(figure: Figure | None, label: str) -> str:
    """An <svg> element to stand in an HTML page; "" of None. label: what it shows, for those who do not see it.

    Its colours are the page's CSS variables of the names in `COLOURS`, its font is the page's. It holds no identifier,
    so that any number of charts may stand in one page, and refers to nothing.
    """
    if figure is None:
        return ""
    root = _drawn(figure)
    width, _ = figure.get_size_inches() * 72
    root.attrib |= {"class": "chart", "style": f"max-width:{width:.0f}px", "role": "img", "aria-label": label}
    text = ElementTree.tostring(root, encoding="unicode")
    for name, colour in COLOURS.items():
        text = text.replace(f": {colour}", f": var(--{name}, {colour})")
    return text


def standalone_svg(figure: Figure) -> str:
    """The content of an SVG file, on white: to be read on light and on dark pages."""
    root = _drawn(figure)
    width, height = figure.get_size_inches() * 72
    root.attrib |= {"xmlns": _SVG[1:-1], "width": f"{width:.0f}", "height": f"{height:.0f}"}
    root.attrib |= {"font-family": "sans-serif"}
    root.insert(0, ElementTree.Element("rect", {"width": "100%", "height": "100%", "fill": "white"}))
    return ElementTree.tostring(root, encoding="unicode") + "\n"


def png(figure: Figure) -> bytes:
    """The content of a PNG file, on white, two pixels for each of the SVG."""
    import matplotlib

    buffer = io.BytesIO()
    with matplotlib.rc_context({"text.parse_math": False}):
        figure.savefig(buffer, format="png", dpi=144, facecolor="white", metadata={"Software": None})
    return buffer.getvalue()


def _drawn(figure: Figure) -> ElementTree.Element:
    """The figure as plain SVG elements without a background: no identifiers, references, clips, fonts or metadata."""
    import matplotlib

    buffer = io.BytesIO()
    with matplotlib.rc_context({"svg.fonttype": "none", "svg.hashsalt": "chart", "text.parse_math": False}):
        figure.savefig(buffer, format="svg", transparent=True, metadata=_NO_METADATA)
    root = ElementTree.fromstring(buffer.getvalue())
    named = {element.get("id"): element for element in root.iter() if element.get("id")}
    for parent in list(root.iter()):
        for child in list(parent):
            if child.tag == _SVG + "use":  # a marker: its outline in its place
                outline = dict(named[child.attrib[_LINK][1:]].attrib)
                place = f"translate({child.attrib.pop('x')} {child.attrib.pop('y')})"
                child.tag, child.attrib = "path", outline | {"style": child.attrib.get("style", ""), "transform": place}
    for parent in list(root.iter()):
        for child in list(parent):
            if child.tag == _SVG + "defs":
                parent.remove(child)
    for element in list(root.iter()):
        element.tag = element.tag.removeprefix(_SVG)
        name = element.attrib.pop("id", "")
        for key in ("clip-path", "version", "width", "height"):
            element.attrib.pop(key, None)
        for key in ("d", "x", "y", "transform"):
            if key in element.attrib:
                element.attrib[key] = re.sub(r"(\.\d\d)\d+", r"\1", " ".join(element.attrib[key].split()))
        if "style" in element.attrib:
            element.attrib["style"] = re.sub(r"font-family: [^;]*;? ?", "", element.attrib["style"])
        element.tail = None
        if element.tag != "text":
            element.text = None
        if name.startswith(TIP):
            tip = ElementTree.Element("title")
            tip.text = name.removeprefix(TIP)
            element.insert(0, tip)
    return root
