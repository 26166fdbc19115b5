"""The page of `pecgrasp strangers`: how well the known are told from strangers, thing by thing, and the worst in
pictures."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from pec.experiments.chart_files import inline_svg
from pec.experiments.charts import histogram, points_over_axes
from pecgrasp_env.common.cloud_image import cloud_image
from pecgrasp_env.common.html_report import Tile, report_page
from pecgrasp_env.experiments.strangers import Answered

__all__ = ["render"]

_PICTURES = 24
_OF_ONE_THING = 2  # pictures at most
_WORDS = {
    "seen": "instances that training saw",
    "known": "unseen instances of the classes",
    "strangers": "strangers",
}


def render(parts: Mapping[str, Answered], results: Mapping[str, Any], checkpoint: str) -> str:
    """The page, of what `strangers.measure` made of `parts`."""
    threshold = results["threshold"]
    strangers, known = results["parts"]["strangers"], results["parts"]["known"]
    tiles = [
        Tile(f"{results['auc']:.3f}", ("area under the ROC curve,", "known against strangers")),
        Tile(f"{1 - strangers['at']['kept']:.1%}", ("of strangers' clouds refused", _interval(strangers["at"], True))),
        Tile(f"{known['at']['kept']:.1%}", ("of unseen instances' clouds kept", _interval(known["at"]))),
        Tile(f"{known['likeliest_right']:.1%}", ("of those the likeliest class", "is right, kept or not")),
    ]
    curve = points_over_axes(
        {"known kept, over strangers kept": results["roc"]}, x_label="strangers kept", y_label="known kept"
    )
    roc = [("ROC", inline_svg(curve, "ROC"))]
    histograms = [
        (f"known of {_WORDS[name]}: {len(part):,} clouds", inline_svg(histogram(part.known), name))
        for name, part in parts.items()
    ]
    return report_page(
        "pecgrasp_env.experiments",
        "strangers",
        "Known things and strangers",
        checkpoint=checkpoint,
        threshold=f"{threshold:.3f}",
        tiles=tiles,
        roc=roc,
        histograms=histograms,
        summary=[_summary(name, row) for name, row in results["parts"].items()],
        things={name: _things(name, results["instances"]) for name in ("strangers", "known") if name in parts},
        absurd=_pictures(parts["strangers"], parts["strangers"].known, threshold),
        lost=_pictures(parts["known"], -parts["known"].known, -threshold),
    )


def _interval(row: Mapping[str, Any], refused: bool = False) -> str:
    low, high = row["interval"]
    low, high = (1 - high, 1 - low) if refused else (low, high)
    return f"{low:.1%} to {high:.1%} over things"


def _summary(name: str, row: Mapping[str, Any]) -> list[str]:
    right = f"{row['at']['right']:.1%}" if "right" in row["at"] else "–"
    likeliest = f"{row['likeliest_right']:.1%}" if "likeliest_right" in row else "–"
    kept = [f"{row[at]['kept']:.1%} ({_interval(row[at])})" for at in ("at", "at_95")]
    return [_WORDS[name], str(row["instances"]), f"{row['clouds']:,}", *kept, right, likeliest]


def _things(part: str, rows: list[dict[str, Any]]) -> list[list[str]]:
    """A row a thing, the worst first."""
    mine = [row for row in rows if row["part"] == part]
    mine.sort(key=lambda row: -row["kept"] if part == "strangers" else row["right"])
    return [
        [
            row["name"],
            str(row["clouds"]),
            f"{row['kept']:.0%}",
            "–" if row["right"] is None else f"{row['right']:.0%}",
            f"{row['median_known']:.2f}",
            ", ".join(f"{name} {count}" for name, count in row["taken_for"].items()),
        ]
        for row in mine
    ]


def _pictures(part: Answered, wrong: np.ndarray, threshold: float) -> list[tuple[str, str]]:
    """Captions and images of the clouds whose `wrong` (n,) is above the threshold, the worst first."""
    shown: dict[str, int] = {}
    pictures: list[tuple[str, str]] = []
    for index in np.argsort(-wrong, kind="stable").tolist():
        name = str(part.names[index])
        if wrong[index] < threshold or len(pictures) == _PICTURES:
            break
        if shown.get(name, 0) == _OF_ONE_THING:
            continue
        shown[name] = shown.get(name, 0) + 1
        caption = f"{name}: {part.likeliest[index]}, known {part.known[index]:.2f}"
        pictures.append((caption, cloud_image(part.dataset.cloud(index).astype(float))))
    return pictures
