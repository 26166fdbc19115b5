"""The cells of a grid side by side: one table with intervals beside the published figures, and the plots."""

from __future__ import annotations

import csv
import io
import json
import math
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from statistics import fmean, stdev
from typing import Any

from pec.common.atomic_files import write_json, write_whole
from pec.experiments.chart_files import png, standalone_svg
from pec.experiments.grid import cell_code
from pec.experiments.grid_plots import grid_plots
from pec.experiments.grid_rows import Row, differing_settings, group_of, other_settings, read_rows, size_name
from pec.metrics.proportions import wilson_interval

__all__ = ["write_table"]


def write_table(folder: str | os.PathLike[str], title: str, published: Sequence[Mapping[str, Any]]) -> str:
    """Write FOLDER/table.md, table.csv, results.json and the plots (SVG and PNG); returns the markdown.

    published: {points, group, accuracy}, group None for no grouping, accuracy in %: beside the rows of model "pec" in
    the published preprocessing.
    """
    folder = Path(folder)
    rows = read_rows(folder)
    figures = {(item["points"], item["group"]): float(item["accuracy"]) for item in published}
    markdown = _markdown(rows, title, figures)
    write_whole(folder / "table.md", markdown)
    write_whole(folder / "table.csv", _csv(rows, figures))
    write_json(folder / "results.json", {"title": title, "code": cell_code(), "rows": _summaries(rows, figures)})
    for name, figure in grid_plots(rows, figures).items():
        write_whole(folder / f"{name}.svg", standalone_svg(figure))
        write_whole(folder / f"{name}.png", png(figure))
    return markdown


def _published(row: Row, figures: Mapping[tuple[int, int | None], float]) -> float | None:
    preprocess = row.settings["preprocess"]
    as_published = preprocess["ordering"] in ("groups", "none") and preprocess["pose"] == "given"
    if row.model != "pec" or not as_published or size_name(preprocess):
        return None
    return figures.get((row.points, group_of(row)))


def _markdown(rows: Sequence[Row], title: str, figures: Mapping[tuple[int, int | None], float]) -> str:
    head = ["model", "points", "order", "protocol", "epochs", "seeds", "best epoch %", "Wilson 95 %", "last epoch %"]
    head += ["train split %", "published %", "calibration error %", "parameters", "multiply-adds"]
    head += ["network ms", "raw cloud ms", "training s"]
    reduced = any(row.precision != "float32" for row in rows)
    head += ["precision"] if reduced else []
    differing = differing_settings(rows)
    head += ["other settings"] if differing else []
    lines = [f"# {title}", "", " | ".join(head), " | ".join(["---"] * len(head))]
    for row in rows:
        published = _published(row, figures)
        fields = [row.model, str(row.points), row.order, row.protocol]
        if row.results:
            low, high = _interval_of_mean(row)
            fields += [
                _range(row.values("epochs")),
                str(len(row.seeds)),
                _percent(row.values("best", "test_accuracy")),
                f"{100 * low:.1f}–{100 * high:.1f}",
                _percent(row.values("last", "test_accuracy")),
                _percent(row.values("best", "train_accuracy")),
                "–" if published is None else f"{published:g}",
                _percent(row.values("best", "test_calibration_error")),
                f"{row.results[0]['parameters']:,}",
                f"{row.results[0]['costs']['multiply_adds']:,}",
                f"{min(row.values('costs', 'network_ms')):.2f}",
                f"{min(row.values('costs', 'raw_cloud_ms')):.2f}",
                _range([round(value) for value in row.values("training_s")]),
            ]
        else:
            fields += ["–", "0", *["–"] * 4, "–" if published is None else f"{published:g}", *["–"] * 6]
        fields += [row.precision] if reduced else []
        fields += [other_settings(row, differing)] if differing else []
        lines.append(" | ".join(fields))
    lines += [
        "",
        "Accuracies are of the test split, mean ± standard deviation over the seeds; Wilson's interval is that of the "
        "mean accuracy on one test split. Protocol honest: the best epoch is that of validation, test is read once. "
        "Protocol published: the best epoch on the evaluation split itself, an optimistic figure. Train split: the "
        "same checkpoint on the clouds that it learnt from. Times are of one cloud on one CPU thread."
        + (" Precision: of the products in training; all figures are of float32 networks." if reduced else ""),
    ]
    failures = [f"- {row.name}, {reason}" for row in rows for reason in row.missing]
    if failures:
        lines += ["", "Not in the table:", "", *failures]
    return "\n".join(lines) + "\n"


def _csv(rows: Sequence[Row], figures: Mapping[tuple[int, int | None], float]) -> str:
    """A line a cell that is done, with Wilson's interval of its own accuracy."""
    text = io.StringIO()
    writer: csv.DictWriter[str] | None = None
    for row in rows:
        for seed, result in zip(row.seeds, row.results, strict=True):
            best, n = result["best"], result["n_samples"]["test"]
            low, high = wilson_interval(round(n * best["test_accuracy"]), n)
            line = {
                "model": row.model,
                "points": row.points,
                "order": row.order,
                "protocol": row.protocol,
                "epochs": result["epochs"],
                "precision": row.precision,
                "seed": seed,
                "best_epoch": best["epoch"],
                "test_accuracy": best["test_accuracy"],
                "wilson_low": low,
                "wilson_high": high,
                "n_test": n,
                "last_test_accuracy": result["last"]["test_accuracy"],
                "train_accuracy": best["train_accuracy"],
                "published": None if (figure := _published(row, figures)) is None else figure / 100,
                "calibration_error": best["test_calibration_error"],
                **result["costs"],
                "training_s": result["training_s"],
                "device": result["device"],
                "settings": json.dumps(row.settings, sort_keys=True),
            }
            if writer is None:
                writer = csv.DictWriter(text, list(line), lineterminator="\n")
                writer.writeheader()
            writer.writerow(line)
    return text.getvalue()


def _summaries(rows: Sequence[Row], figures: Mapping[tuple[int, int | None], float]) -> list[dict[str, Any]]:
    summaries = []
    for row in rows:
        accuracies = row.values("best", "test_accuracy")
        summaries.append(
            {
                "settings": row.settings,
                "protocol": row.protocol,
                "seeds": row.seeds,
                "epochs": row.values("epochs"),
                "precision": row.precision,
                "test_accuracy": accuracies,
                "mean": fmean(accuracies) if accuracies else None,
                "deviation": stdev(accuracies) if len(accuracies) > 1 else None,
                "wilson": list(_interval_of_mean(row)) if accuracies else None,
                "last_test_accuracy": row.values("last", "test_accuracy"),
                "train_accuracy": row.values("best", "train_accuracy"),
                "published": None if (figure := _published(row, figures)) is None else figure / 100,
                "costs": row.values("costs"),
                "training_s": row.values("training_s"),
                "missing": row.missing,
            }
        )
    return summaries


def _interval_of_mean(row: Row) -> tuple[float, float]:
    """Wilson's 95 % interval of the mean accuracy over the seeds on one test split.

    Written out because a mean over seeds is no whole count of clouds, which `wilson_interval` takes.
    """
    n, p, z = row.results[0]["n_samples"]["test"], fmean(row.values("best", "test_accuracy")), 1.959964
    centre = (p + z * z / (2 * n)) / (1 + z * z / n)
    half = z / (1 + z * z / n) * math.sqrt(p * (1 - p) / n + z * z / (4 * n * n))
    # At the ends the formula is exact but its arithmetic is not.
    return (0.0 if p == 0 else centre - half, 1.0 if p == 1 else centre + half)


def _percent(shares: Sequence[float]) -> str:
    mean = f"{100 * fmean(shares):.2f}"
    return f"{mean} ± {100 * stdev(shares):.2f}" if len(shares) > 1 else mean


def _range(values: Sequence[float]) -> str:
    low, high = min(values), max(values)
    return f"{low:g}" if low == high else f"{low:g}–{high:g}"
