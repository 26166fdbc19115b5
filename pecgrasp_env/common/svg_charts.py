"""Small charts as inline SVG: confusion matrix, bars, curve, histogram. Their colours come from the page's style."""

from __future__ import annotations

import html
from collections.abc import Sequence

import numpy as np


def confusion_matrix(counts: np.ndarray, classes: Sequence[str]) -> str:
    """counts: (C, C), row = true class, column = predicted. Cells are shaded by their share of the row."""
    counts = np.asarray(counts)
    n, cell, left, top = len(classes), 46, 116, 26
    width, bottom = left + n * cell + 58, top + n * cell
    parts = [_text(left + n * cell / 2, 14, "predicted", "middle", "soft")]
    parts.append(_text(left + n * cell + 52, 14, "right", "end", "soft"))
    for i, name in enumerate(classes):
        y = top + i * cell
        parts.append(_text(left - 8, y + cell / 2 + 4, name, "end"))
        turn = left + i * cell + cell / 2
        label = _text(turn, bottom + 14, name, "end", extra=f' transform="rotate(-35 {turn:.0f} {bottom + 14})"')
        parts.append(label)
        total = int(counts[i].sum())
        for j in range(n):
            share = counts[i, j] / total if total else 0.0
            kind = "good" if i == j else "bad"
            x, tip = left + j * cell, f"{name} taken for {classes[j]}: {counts[i, j]} of {total}"
            parts.append(
                f'<rect class="cell {kind}" x="{x}" y="{y}" width="{cell - 2}" height="{cell - 2}" rx="3" '
                f'fill-opacity="{0.06 + 0.86 * share:.3f}"><title>{html.escape(tip)}</title></rect>'
            )
            if counts[i, j]:
                ink = "over" if share > 0.55 else ""
                parts.append(_text(x + cell / 2 - 1, y + cell / 2 + 4, str(counts[i, j]), "middle", ink))
        share = f"{100 * counts[i, i] / total:.1f} %" if total else "–"
        parts.append(_text(left + n * cell + 52, y + cell / 2 + 4, share, "end"))
    return _svg(width, bottom + 74, parts, "confusion matrix of the classifier")


def bars(rows: Sequence[tuple[str, float, float]], unit: str, label: str) -> str:
    """rows: (name, median, maximum). The bar is the median, the whisker the maximum, on a logarithmic scale."""
    rows = [row for row in rows if row[2] > 0]
    if not rows:
        return ""
    low = 10 ** np.floor(np.log10(min(max(median, maximum * 1e-3) for _, median, maximum in rows)))
    high = 10 ** np.ceil(np.log10(max(maximum for *_, maximum in rows)))
    high = high if high > low else 10 * low
    left, right, line, width = 122, 104, 28, 520

    def place(value: float) -> float:
        share = np.log10(max(value, low) / low) / np.log10(high / low)
        return float(left + share * (width - left - right))

    parts = []
    bottom = 10 + line * len(rows)
    powers = range(round(np.log10(low)), round(np.log10(high)) + 1)
    for k, power in enumerate(powers):
        x = place(10.0**power)
        parts.append(f'<line class="grid" x1="{x:.1f}" y1="4" x2="{x:.1f}" y2="{bottom}"/>')
        if k % (1 + len(powers) // 6) == 0:  # labels would run into each other
            parts.append(_text(x, bottom + 16, f"{10.0**power:g} {unit}", "middle", "soft"))
    for k, (name, median, maximum) in enumerate(rows):
        y = 10 + line * k
        parts.append(_text(left - 10, y + 14, name, "end"))
        parts.append(f'<line class="whisker" x1="{left}" y1="{y + 10}" x2="{place(maximum):.1f}" y2="{y + 10}"/>')
        bar = max(2.0, place(median) - left)
        parts.append(f'<rect class="bar" x="{left}" y="{y + 2}" width="{bar:.1f}" height="16" rx="2"/>')
        parts.append(f'<circle class="whisker" cx="{place(maximum):.1f}" cy="{y + 10}" r="3"/>')
        parts.append(_text(width, y + 14, f"{number(median)} / {number(maximum)} {unit}", "end"))
    return _svg(width, bottom + 24, parts, label)


def curve(series: dict[str, Sequence[float]], label: str) -> str:
    """Shares in [0, 1] over epochs, one line a series. Epochs count from 1."""
    longest = max((len(values) for values in series.values()), default=0)
    if longest == 0:
        return ""
    width, height, left, top = 420, 220, 44, 12
    across, down = width - left - 12, height - top - 34
    parts = []
    for share in (0.0, 0.25, 0.5, 0.75, 1.0):
        y = top + (1 - share) * down
        parts.append(f'<line class="grid" x1="{left}" y1="{y:.1f}" x2="{left + across}" y2="{y:.1f}"/>')
        parts.append(_text(left - 6, y + 4, f"{100 * share:.0f} %", "end", "soft"))
    for k, (name, values) in enumerate(series.items()):
        steps = max(1, longest - 1)
        xy = [(left + across * i / steps, top + (1 - value) * down) for i, value in enumerate(values)]
        path = " ".join(f"{x:.1f},{y:.1f}" for x, y in xy)
        parts.append(f'<polyline class="line line{k}" points="{path}"/>')
        parts.append(_text(left + across - 4, top + down - 10 - 16 * k, name, "end", f"name{k}"))
    parts.append(_text(left, height - 14, "epoch 1", "start", "soft"))
    parts.append(_text(left + across, height - 14, str(longest), "end", "soft"))
    return _svg(width, height, parts, label)


def histogram(values: np.ndarray, label: str, unit: str = "", log: bool = False, bins: int = 40) -> str:
    """How often values (n,) occur, in bins of one width, or of one ratio where `log`; the tip of a bar is its count."""
    values = np.asarray(values, float)
    values = values[np.isfinite(values) & (values > 0 if log else True)]
    if not len(values):
        return ""
    low, high = float(values.min()), float(values.max())
    if low == high:
        low, high = (low / 1.5, high * 1.5) if log else (low - 0.5, high + 0.5)
    edges = np.geomspace(low, high, bins + 1) if log else np.linspace(low, high, bins + 1)
    counts, _ = np.histogram(values, edges)
    width, height, left, top = 420, 200, 12, 12
    across, down = width - 2 * left, height - top - 34
    bar = across / bins
    parts = []
    for k, count in enumerate(counts.tolist()):
        tall = down * count / counts.max()
        tip = html.escape(f"{number(edges[k])} to {number(edges[k + 1])} {unit}: {count:,}")
        parts.append(
            f'<rect class="bar" x="{left + k * bar:.1f}" y="{top + down - tall:.1f}" width="{max(bar - 1, 0.5):.1f}" '
            f'height="{tall:.1f}"><title>{tip}</title></rect>'
        )
    parts.append(f'<line class="grid" x1="{left}" y1="{top + down}" x2="{left + across}" y2="{top + down}"/>')
    for share, anchor in ((0.0, "start"), (0.5, "middle"), (1.0, "end")):
        value = low * (high / low) ** share if log else low + share * (high - low)
        parts.append(_text(left + share * across, height - 14, f"{number(value)} {unit}", anchor, "soft"))
    return _svg(width, height, parts, label)


def number(value: float) -> str:
    """Three significant digits, no exponent for what people meet."""
    if value >= 100:
        return f"{value:.0f}"
    return f"{value:.3g}" if value >= 0.01 or value == 0 else f"{value:.1g}"


def _text(x: float, y: float, words: str, anchor: str, kind: str = "", extra: str = "") -> str:
    return f'<text class="{kind}" x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}"{extra}>{html.escape(words)}</text>'


def _svg(width: float, height: float, parts: Sequence[str], label: str) -> str:
    return (
        f'<svg class="chart" viewBox="0 0 {width:.0f} {height:.0f}" style="max-width:{width:.0f}px" role="img" '
        f'aria-label="{html.escape(label)}">{"".join(parts)}</svg>'
    )
