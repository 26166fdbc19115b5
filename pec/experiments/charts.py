"""Charts, drawn by matplotlib: points over two axes, learning curves, bars, a histogram, a confusion matrix.

Each function returns a figure, or None where there is nothing to draw; `chart_files` makes SVG or PNG of it.
matplotlib is imported where something is drawn, not with this module.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["COLOURS", "TIP", "bars", "confusion_matrix", "curves", "histogram", "number", "points_over_axes"]

COLOURS = {
    "ink": "#1c2330",
    "soft": "#5c6675",
    "line": "#dfe3e9",
    "paper": "#fefefe",
    "accent": "#0b6e8f",
    "good": "#1b7f4d",
    "bad": "#b3372f",
    "warn": "#9a6400",
}
"""Name to colour. A page that defines CSS variables of these names shows the chart in its own colours."""
TIP = "tip: "
"""Begins the group identifier of an artist that an SVG shows a tip for."""
_SERIES = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000", "#999999")  # Okabe, Ito 2008
_STYLE: dict[Any, Any] = {
    "font.family": "DejaVu Sans",  # ships with matplotlib: texts are measured alike everywhere
    "font.size": 12,
    "text.parse_math": False,
    "text.color": COLOURS["ink"],
    "axes.labelcolor": COLOURS["ink"],
    "axes.edgecolor": COLOURS["line"],
    "xtick.labelcolor": COLOURS["soft"],
    "ytick.labelcolor": COLOURS["soft"],
    "grid.color": COLOURS["line"],
    "axes.axisbelow": True,
}


def points_over_axes(
    series: Mapping[str, Sequence[tuple[float, float]]],
    *,
    x_label: str,
    y_label: str,
    x_ticks: Mapping[float, str] | None = None,
    logarithmic: bool = False,
) -> Figure:
    """(x, y) points, a line through those of each series; a single point stands by itself.

    x_ticks: what to write at which x, where it is not a scale. logarithmic: of x, which is positive then.
    Raises ValueError where there is no finite point.
    """
    kept = {
        name: [(x, y) for x, y in points if math.isfinite(x) and math.isfinite(y)] for name, points in series.items()
    }
    xs = [x for points in kept.values() for x, _ in points]
    if not xs:
        raise ValueError("a chart needs at least one finite point")
    if x_ticks is None and logarithmic:
        x_ticks = {x: f"{x:g}" for x in _decades(min(xs), max(xs))}
    # The legend stands beside the axes and must not squeeze them.
    with _axes(532 + 7 * max(map(len, kept)), max(342, 32 + 18 * len(kept))) as (figure, ax):
        handles = []
        for k, (name, points) in enumerate(kept.items()):
            colour, dashes = _SERIES[k % len(_SERIES)], "-" if k < len(_SERIES) else (0, (4, 2))
            handles += ax.plot(*np.reshape(points, (-1, 2)).T, color=colour, linestyle=dashes, linewidth=1.5)
            if len(points) < 30:
                for x, y in points:
                    ax.plot([x], [y], "o", markersize=6, color=colour, gid=f"{TIP}{_clean(name)}: {x:g}, {y:g}")
        if logarithmic:
            ax.set_xscale("log")
        if x_ticks is not None:
            ax.set_xticks(list(x_ticks), [_clean(words) for words in x_ticks.values()])
            ax.minorticks_off()
        ax.set(xlabel=x_label, ylabel=y_label)
        ax.grid(linewidth=0.8)
        figure.legend(handles, [_clean(name) for name in kept], loc="outside right upper", frameon=False)
        return figure


def curves(series: Mapping[str, Sequence[float]]) -> Figure | None:
    """Shares in [0, 1] over epochs, one line a series. Epochs count from 1."""
    from matplotlib.ticker import MaxNLocator, PercentFormatter

    if not any(len(values) for values in series.values()):
        return None
    with _axes(420, 220) as (figure, ax):
        lines = []
        for values, colour in zip(series.values(), _theme_colours(len(series)), strict=True):
            lines += ax.plot(range(1, len(values) + 1), values, color=colour, linewidth=2)
        ax.set(ylim=(0, 1), yticks=np.linspace(0, 1, 5), xlabel="epoch")
        ax.margins(x=0)
        ax.xaxis.set_major_locator(MaxNLocator(integer=True))
        ax.yaxis.set_major_formatter(PercentFormatter(1, decimals=0, symbol=" %"))
        ax.grid(axis="y", linewidth=1)
        names = [_clean(name) for name in series]
        legend = ax.legend(lines, names, loc="lower right", frameon=False, labelcolor="linecolor", reverse=True)
        for line in legend.get_lines():
            line.set_visible(False)  # the colour of the words says it
        return figure


def bars(rows: Sequence[tuple[str, float, float]], unit: str) -> Figure | None:
    """rows: (name, median, maximum). The bar is the median, the dot the maximum, on a logarithmic scale."""
    rows = [row for row in rows if row[2] > 0]
    if not rows:
        return None
    low = 10 ** np.floor(np.log10(min(max(median, maximum * 1e-3) for _, median, maximum in rows)))
    high = 10 ** np.ceil(np.log10(max(maximum for *_, maximum in rows)))
    longest = max(len(name) for name, *_ in rows)
    with _axes(420 + 7 * longest, 34 + 28 * len(rows)) as (figure, ax):
        ax.set(xscale="log", xlim=(low, max(high, 10 * low)), ylim=(len(rows) - 0.4, -0.6))
        for k, (name, median, maximum) in enumerate(rows):
            tip = f"{TIP}{_clean(name)}: median {number(median)} {unit}, most {number(maximum)} {unit}"
            ax.barh(k, max(median, low * 1.02) - low, left=low, height=0.58, color=COLOURS["accent"], gid=tip)
            ax.plot([median, maximum], [k, k], color=COLOURS["soft"], linewidth=1, clip_on=False)
            ax.plot([maximum], [k], "o", markersize=6, color=COLOURS["soft"], clip_on=False, gid=tip)
            words = f"{number(median)} / {number(maximum)} {unit}"
            ax.annotate(words, (1, k), (12, 0), ("axes fraction", "data"), textcoords="offset points", va="center")
        ax.set_yticks(range(len(rows)), [_clean(name) for name, *_ in rows], color=COLOURS["ink"])
        ax.minorticks_off()
        ax.xaxis.set_major_formatter(lambda value, _: f"{value:g} {unit}")
        ax.grid(axis="x", linewidth=1)
        return figure


def histogram(values: np.ndarray, unit: str = "", log: bool = False, bins: int = 40) -> Figure | None:
    """How often values (n,) occur, in bins of one width, or of one ratio where `log`; the tip of a bar is its count."""
    values = np.asarray(values, float)
    values = values[np.isfinite(values) & (values > 0 if log else True)]
    if not len(values):
        return None
    low, high = float(values.min()), float(values.max())
    if low == high:
        low, high = (low / 1.5, high * 1.5) if log else (low - 0.5, high + 0.5)
    edges = np.geomspace(low, high, bins + 1) if log else np.linspace(low, high, bins + 1)
    counts, _ = np.histogram(values, edges)
    with _axes(420, 200) as (figure, ax):
        ax.set(xscale="log" if log else "linear", yticks=[], xlim=(low, high), ylim=(0, 1.05 * counts.max()))
        for left, right, count in zip(edges[:-1], edges[1:], counts.tolist(), strict=True):
            tip = f"{TIP}{number(left)} to {number(right)} {unit}".rstrip() + f": {count:,}"
            ax.bar(left, count, 0.85 * (right - left), align="edge", color=COLOURS["accent"], gid=tip)
        places = [low * (high / low) ** share if log else low + share * (high - low) for share in (0.0, 0.5, 1.0)]
        labels = ax.set_xticks(places, [f"{number(value)} {unit}" for value in places])
        ax.minorticks_off()
        for tick, anchor in zip(labels, ("left", "center", "right"), strict=True):
            tick.label1.set(horizontalalignment=anchor)
        ax.spines["bottom"].set_visible(True)
        return figure


def confusion_matrix(counts: np.ndarray, classes: Sequence[str]) -> Figure:
    """counts: (C, C), row = true class, column = predicted. Cells are shaded by their share of the row."""
    from matplotlib.patches import Rectangle

    counts, n, cell = np.asarray(counts), len(classes), 46
    names = [_clean(name) for name in classes]
    longest = max(map(len, names), default=0)  # its letters, beside the cells and aslant below them, need room
    with _axes(75 + 7 * longest + n * cell, 45 + 4.5 * longest + n * cell) as (figure, ax):
        for i, name in enumerate(names):
            total = int(counts[i].sum())
            for j, other in enumerate(names):
                share = counts[i, j] / total if total else 0.0
                colour = COLOURS["good" if i == j else "bad"]
                tip = f"{TIP}{name} taken for {other}: {counts[i, j]} of {total}"
                look: dict[str, Any] = {"color": colour, "alpha": 0.06 + 0.86 * share, "linewidth": 0, "gid": tip}
                ax.add_patch(Rectangle((j + 0.02, i + 0.02), 0.96, 0.96, **look))
                if counts[i, j]:
                    ink = COLOURS["paper" if share > 0.55 else "ink"]
                    ax.text(j + 0.5, i + 0.5, str(counts[i, j]), color=ink, ha="center", va="center_baseline")
            share = f"{100 * counts[i, i] / total:.1f} %" if total else "–"
            ax.annotate(share, (n, i + 0.5), (48, 0), textcoords="offset points", ha="right", va="center")
        ax.annotate("right", (n, 0), (48, 5), textcoords="offset points", ha="right", color=COLOURS["soft"])
        ax.annotate("predicted", (n / 2, 0), (0, 5), textcoords="offset points", ha="center", color=COLOURS["soft"])
        ax.set(xlim=(0, n), ylim=(n, 0), aspect="equal")
        ax.set_xticks(np.arange(n) + 0.5, names, rotation=35, ha="right", rotation_mode="anchor", color=COLOURS["ink"])
        ax.set_yticks(np.arange(n) + 0.5, names, color=COLOURS["ink"])
        return figure


def number(value: float) -> str:
    """Three significant digits, no exponent for what people meet."""
    if value >= 100:
        return f"{value:.0f}"
    return f"{value:.3g}" if value >= 0.01 or value == 0 else f"{value:.1g}"


@contextmanager
def _axes(width: float, height: float) -> Iterator[tuple[Figure, Axes]]:
    """A figure of so many pixels and its axes without a frame, in the style of all charts."""
    import matplotlib
    from matplotlib.figure import Figure

    with matplotlib.rc_context(_STYLE):
        figure = Figure(figsize=(width / 72, height / 72), dpi=72, layout="constrained")
        ax = figure.add_subplot()
        ax.tick_params(length=0, pad=6, which="both")
        ax.spines[:].set_visible(False)
        yield figure, ax


def _theme_colours(n: int) -> list[str]:
    names = ("accent", "warn", "good", "bad")
    return [COLOURS[names[k % len(names)]] for k in range(n)]


def _decades(low: float, high: float) -> list[float]:
    """1, 2 and 5 times powers of ten that enclose low to high."""
    powers = range(math.floor(math.log10(low)) - 1, math.ceil(math.log10(high)) + 2)
    every = [factor * 10.0**power for power in powers for factor in (1, 2, 5)]
    return [x for x in every if max(e for e in every if e <= low) <= x <= min(e for e in every if e >= high)]


def _clean(words: str) -> str:
    """Without characters that XML has no place for."""
    return "".join(character if character.isprintable() else "\N{REPLACEMENT CHARACTER}" for character in words)
