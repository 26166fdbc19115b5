"""One chart as an SVG file: lines or labelled points over two axes."""

from __future__ import annotations

import html
import math
from collections.abc import Mapping, Sequence

__all__ = ["chart"]

_COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000", "#999999")  # Okabe, Ito 2008
_LEFT, _TOP, _ACROSS, _DOWN = 64, 16, 420, 280


def chart(
    series: Mapping[str, Sequence[tuple[float, float]]],
    *,
    x_label: str,
    y_label: str,
    x_ticks: Mapping[float, str] | None = None,
    logarithmic: bool = False,
) -> str:
    """A standalone SVG of (x, y) points, a line through those of each series; a single point stands by itself.

    x_ticks: what to write at which x, where it is not a scale. logarithmic: of x, which is positive then.
    Raises ValueError where there is no finite point.
    """
    kept = {
        name: [(x, y) for x, y in points if math.isfinite(x) and math.isfinite(y)] for name, points in series.items()
    }
    every = [point for points in kept.values() for point in points]
    if not every:
        raise ValueError("a chart needs at least one finite point")

    def scaled(x: float) -> float:
        return math.log10(x) if logarithmic else x

    xs, ys = [scaled(x) for x, _ in every], [y for _, y in every]
    y_marks = _ticks(min(ys), max(ys))
    if x_ticks is not None:
        marks = {scaled(x): text for x, text in x_ticks.items()}
    elif logarithmic:
        marks = {math.log10(x): f"{x:g}" for x in _decades(min(xs), max(xs))}
    else:
        marks = {x: f"{x:g}" for x in _ticks(min(xs), max(xs))}
    x_low, x_high = min([*xs, *marks]), max([*xs, *marks])
    margin = 0.04 * (x_high - x_low) or 0.5
    x_low, x_high = x_low - margin, x_high + margin

    def place(x: float, y: float) -> tuple[float, float]:
        return (
            _LEFT + _ACROSS * (x - x_low) / (x_high - x_low),
            _TOP + _DOWN * (y_marks[-1] - y) / (y_marks[-1] - y_marks[0]),
        )

    parts = []
    for y in y_marks:
        _, v = place(x_low, y)
        parts.append(f'<line x1="{_LEFT}" y1="{v:.1f}" x2="{_LEFT + _ACROSS}" y2="{v:.1f}" stroke="#ddd"/>')
        parts.append(_text(_LEFT - 6, v + 4, f"{y:g}", "end"))
    for x, words in marks.items():
        u, _ = place(x, y_marks[0])
        parts.append(f'<line x1="{u:.1f}" y1="{_TOP}" x2="{u:.1f}" y2="{_TOP + _DOWN}" stroke="#eee"/>')
        parts.append(_text(u, _TOP + _DOWN + 16, words, "middle"))
    for k, (name, points) in enumerate(kept.items()):
        colour = _COLOURS[k % len(_COLOURS)]
        dash = ' stroke-dasharray="5 3"' if k >= len(_COLOURS) else ""
        places = [place(scaled(x), y) for x, y in points]
        path = " ".join(f"{u:.1f},{v:.1f}" for u, v in places)
        parts.append(f'<polyline points="{path}" fill="none" stroke="{colour}" stroke-width="1.5"{dash}/>')
        radius = 3.5 if len(points) < 30 else 0
        for (u, v), (x, y) in zip(places, points, strict=True):
            tip = html.escape(f"{name}: {x:g}, {y:g}")
            parts.append(
                f'<circle cx="{u:.1f}" cy="{v:.1f}" r="{radius}" fill="{colour}"><title>{tip}</title></circle>'
            )
        v = _TOP + 8 + 16 * k
        parts.append(f'<rect x="{_LEFT + _ACROSS + 14}" y="{v - 5}" width="12" height="4" fill="{colour}"/>')
        parts.append(_text(_LEFT + _ACROSS + 32, v + 1, name, "start"))
    parts.append(_text(_LEFT + _ACROSS / 2, _TOP + _DOWN + 36, x_label, "middle"))
    turned = f'transform="rotate(-90 14 {_TOP + _DOWN / 2})"'
    parts.append(_text(14, _TOP + _DOWN / 2, y_label, "middle", turned))
    width = _LEFT + _ACROSS + 48 + 7 * max(len(name) for name in kept)
    height = max(_TOP + _DOWN + 46, _TOP + 16 * len(kept) + 16)
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" width="{width}" height="{height}" '
        f'font-family="sans-serif" font-size="12"><rect width="100%" height="100%" fill="white"/>'
        f"{''.join(parts)}</svg>\n"
    )


def _ticks(low: float, high: float) -> list[float]:
    """Three to seven round values that enclose [low, high]."""
    span = max(high - low, 1e-9 * max(abs(low), abs(high), 1.0))  # equal values have a scale too
    step = 10 ** math.floor(math.log10(span / 2))
    step *= next(factor for factor in (1, 2, 5, 10) if span / (factor * step) <= 5)
    first, last = math.floor(low / step + 1e-9), math.ceil(high / step - 1e-9)
    digits = max(0, 1 - math.floor(math.log10(step)))
    return [round(k * step, digits) for k in range(first, max(last, first + 1) + 1)]


def _decades(low: float, high: float) -> list[float]:
    """1, 2 and 5 times powers of ten that enclose 10 ** low to 10 ** high."""
    every = [factor * 10.0**power for power in range(math.floor(low) - 1, math.ceil(high) + 2) for factor in (1, 2, 5)]
    inside = [x for x in every if low <= math.log10(x) <= high]
    return [max(x for x in every if math.log10(x) <= low), *inside, min(x for x in every if math.log10(x) >= high)]


def _text(x: float, y: float, words: str, anchor: str, extra: str = "") -> str:
    return f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}" fill="#333" {extra}>{html.escape(words)}</text>'
