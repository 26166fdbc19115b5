"""The cells of a grid side by side: one table with intervals beside the published figures, and the plots."""

from __future__ import annotations

import csv
import io
import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import fmean, stdev
from typing import TYPE_CHECKING, Any

from pec.common.atomic_files import write_json, write_whole
from pec.experiments.chart_files import png, standalone_svg
from pec.experiments.charts import points_over_axes
from pec.experiments.grid import cell_code, read_cells
from pec.statistics import wilson_interval
from pec.training.config import flat_settings

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["Row", "order_name", "protocol_name", "read_rows", "write_table"]


@dataclass(frozen=True)
class Row:
    """Cells that differ in nothing but their seed. Lists have one value a seed that is done; accuracies in [0, 1]."""

    settings: dict[str, Any]
    """Resolved, without the seed."""
    seeds: list[int]
    results: list[dict[str, Any]]
    missing: list[str]
    """Of the seeds that are not done, which and why."""

    @property
    def points(self) -> int:
        return self.settings["preprocess"]["n_points"]

    @property
    def model(self) -> str:
        return self.settings["model"]["name"]

    @property
    def order(self) -> str:
        return order_name(self.settings["preprocess"])

    @property
    def protocol(self) -> str:
        return protocol_name(self.settings["protocol"])

    @property
    def precision(self) -> str:
        """Of the products in training; cells that were made before there was a choice say nothing."""
        return self.settings["protocol"].get("precision", "float32")

    @property
    def name(self) -> str:
        name = f"{self.model}, {self.points} points, {self.order}, {self.protocol}"
        return name if self.precision == "float32" else f"{name}, {self.precision}"

    def values(self, *path: str) -> list[float]:
        """What results.json has at `path`, of every seed that is done."""
        found: list[Any] = list(self.results)
        for name in path:
            found = [value[name] for value in found]
        return found


def protocol_name(protocol: Mapping[str, Any]) -> str:
    """ "honest" or "published", of `ProtocolConfig` as a mapping."""
    return "honest" if protocol["selection"] == "validation" else "published"


def order_name(preprocess: Mapping[str, Any]) -> str:
    """ "groups of 16", "no grouping", or the ordering and the pose that are ours, of `Preprocess` as a mapping; and the
    size where it is not the published one."""
    size = _size_name(preprocess)
    if preprocess["ordering"] == "groups":
        return f"groups of {preprocess['group_size']}{size}"
    if preprocess["ordering"] == "none":
        return f"no grouping{size}"
    return f"{preprocess['ordering']}, {preprocess['pose']} pose{size}"


def _size_name(preprocess: Mapping[str, Any]) -> str:
    size = preprocess.get("size", "kept")  # the default, which a configuration need not name
    return "" if size == "kept" else f", {size} size"


def read_rows(folder: str | os.PathLike[str]) -> list[Row]:
    """The cells of `folder` that the present code made, joined over their seeds."""
    groups: dict[str, list[dict[str, Any]]] = {}
    for cell in read_cells(folder):
        settings = {name: value for name, value in cell["settings"].items() if name != "seed"}
        groups.setdefault(json.dumps([settings, cell["data"]], sort_keys=True), []).append(cell)
    rows = []
    for cells in groups.values():
        cells.sort(key=lambda cell: cell["settings"]["seed"])
        done = [cell for cell in cells if cell["status"] == "done"]
        rows.append(
            Row(
                {name: value for name, value in cells[0]["settings"].items() if name != "seed"},
                [cell["settings"]["seed"] for cell in done],
                [cell["results"] for cell in done],
                [
                    f"seed {cell['settings']['seed']}: {cell['error'] or cell['status']}"
                    for cell in cells
                    if cell["status"] != "done"
                ],
            )
        )
    return sorted(rows, key=lambda row: (row.settings["model"]["name"], row.protocol, row.points, _group(row) or 1e9))


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
    for name, figure in _plots(rows, figures).items():
        write_whole(folder / f"{name}.svg", standalone_svg(figure))
        write_whole(folder / f"{name}.png", png(figure))
    return markdown


def _group(row: Row) -> int | None:
    preprocess = row.settings["preprocess"]
    return preprocess["group_size"] if preprocess["ordering"] == "groups" else None


def _published(row: Row, figures: Mapping[tuple[int, int | None], float]) -> float | None:
    preprocess = row.settings["preprocess"]
    as_published = preprocess["ordering"] in ("groups", "none") and preprocess["pose"] == "given"
    if row.model != "pec" or not as_published or _size_name(preprocess):
        return None
    return figures.get((row.points, _group(row)))


def _markdown(rows: Sequence[Row], title: str, figures: Mapping[tuple[int, int | None], float]) -> str:
    head = ["model", "points", "order", "protocol", "epochs", "seeds", "best epoch %", "Wilson 95 %", "last epoch %"]
    head += ["train split %", "published %", "calibration error %", "parameters", "multiply-adds"]
    head += ["network ms", "raw cloud ms", "training s"]
    reduced = any(row.precision != "float32" for row in rows)
    head += ["precision"] if reduced else []
    differing = _differing(rows)
    head += ["other settings"] if differing else []
    lines = [f"# {title}", "", " | ".join(head), " | ".join(["---"] * len(head))]
    for row in rows:
        published = _published(row, figures)
        fields = [row.model, str(row.points), row.order, row.protocol]
        if row.results:
            low, high = _wilson(row)
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
        fields += [_others(row, differing)] if differing else []
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
            low, high = wilson_interval(n * best["test_accuracy"], n)
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
                "wilson": list(_wilson(row)) if accuracies else None,
                "last_test_accuracy": row.values("last", "test_accuracy"),
                "train_accuracy": row.values("best", "train_accuracy"),
                "published": None if (figure := _published(row, figures)) is None else figure / 100,
                "costs": row.values("costs"),
                "training_s": row.values("training_s"),
                "missing": row.missing,
            }
        )
    return summaries


def _plots(rows: Sequence[Row], figures: Mapping[tuple[int, int | None], float]) -> dict[str, Figure]:
    """Each plot that the rows have something to show in."""
    done = [row for row in rows if row.results]
    means = {id(row): 100 * fmean(row.values("best", "test_accuracy")) for row in done}
    plots = {}
    grouped: dict[str, list[tuple[float, float]]] = {}
    for row in done:
        if row.settings["preprocess"]["ordering"] in ("groups", "none"):
            place = float(_group(row) or row.points)  # no grouping is one group of all
            name = f"{row.model}, {row.points} points{_size_name(row.settings['preprocess'])}, {row.protocol}"
            grouped.setdefault(name, []).append((place, means[id(row)]))
    if len({x for points in grouped.values() for x, _ in points}) > 1:
        for (points, group), accuracy in figures.items():
            grouped.setdefault(f"dissertation, {points} points", []).append((float(group or points), accuracy))
        series = {name: sorted(points) for name, points in grouped.items()}
        sizes = sorted({x for points in series.values() for x, _ in points})
        plots["accuracy_by_group_size"] = points_over_axes(
            series,
            x_label="points in a group; the rightmost of a line: no grouping",
            y_label="test accuracy, %",
            x_ticks={size: f"{size:g}" for size in sizes},
            logarithmic=True,
        )
    latencies = {}
    differing = _differing(rows)
    for row in done:
        alone = sum(other.name == row.name for other in done) == 1
        others = "" if alone else _others(row, differing)
        name = f"{row.name}, {others}" if others else row.name
        latencies[name] = [(min(row.values("costs", "raw_cloud_ms")), means[id(row)])]
    if len(latencies) > 1:
        plots["accuracy_by_latency"] = points_over_axes(
            latencies,
            x_label="ms from a raw cloud to its class, one CPU thread",
            y_label="test accuracy, %",
            logarithmic=True,
        )
    rates = {row.settings["protocol"]["learning_rate"] for row in done}
    if len(rates) > 1:
        for curve, label in (("selection_accuracy", "selection accuracy, %"), ("train_loss", "training loss")):
            factor = 100 if curve.endswith("accuracy") else 1
            series = {}
            for row in done:
                epochs = zip(*(result["curves"][curve] for result in row.results), strict=True)
                name = f"rate {row.settings['protocol']['learning_rate']:g}, {row.order}"
                series[name] = [(float(e), factor * fmean(values)) for e, values in enumerate(epochs, 1)]
            plots[f"learning_curves_{curve}"] = points_over_axes(series, x_label="epoch", y_label=label)
    return plots


def _differing(rows: Sequence[Row]) -> list[str]:
    """Names of settings that are not the same in all rows and that no column says."""
    said = ("model.", "preprocess.", "protocol.selection", "protocol.epochs", "protocol.precision")
    flat = [flat_settings(row.settings) for row in rows]
    names = sorted({name for settings in flat for name in settings if not name.startswith(said)})
    return [name for name in names if len({str(settings.get(name)) for settings in flat}) > 1]


def _others(row: Row, differing: Sequence[str]) -> str:
    """The `differing` settings of a row; one that it does not name has its default."""
    flat = flat_settings(row.settings)
    return ", ".join(f"{name}={flat[name]}" for name in differing if name in flat)


def _wilson(row: Row) -> tuple[float, float]:
    n = row.results[0]["n_samples"]["test"]
    return wilson_interval(n * fmean(row.values("best", "test_accuracy")), n)


def _percent(shares: Sequence[float]) -> str:
    mean = f"{100 * fmean(shares):.2f}"
    return f"{mean} ± {100 * stdev(shares):.2f}" if len(shares) > 1 else mean


def _range(values: Sequence[float]) -> str:
    low, high = min(values), max(values)
    return f"{low:g}" if low == high else f"{low:g}–{high:g}"
