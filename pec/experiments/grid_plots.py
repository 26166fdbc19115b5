"""What the rows of a grid show as plots: accuracy by the size of groups and by latency, and learning curves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from statistics import fmean
from typing import TYPE_CHECKING

from pec.experiments.charts import points_over_axes
from pec.experiments.grid_rows import Row, differing_settings, group_of, other_settings, size_name

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["grid_plots"]


def grid_plots(rows: Sequence[Row], figures: Mapping[tuple[int, int | None], float]) -> dict[str, Figure]:
    """Each plot that the rows have something to show in, by its name.

    figures: published accuracies, %, by points and group; they are shown where accuracy is, over the size of groups.
    """
    done = [row for row in rows if row.results]
    means = {id(row): 100 * fmean(row.values("best", "test_accuracy")) for row in done}
    plots = {}
    grouped: dict[str, list[tuple[float, float]]] = {}
    for row in done:
        if row.settings["preprocess"]["ordering"] in ("groups", "none"):
            place = float(group_of(row) or row.points)  # no grouping is one group of all
            name = f"{row.model}, {row.points} points{size_name(row.settings['preprocess'])}, {row.protocol}"
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
    differing = differing_settings(rows)
    for row in done:
        alone = sum(other.name == row.name for other in done) == 1
        others = "" if alone else other_settings(row, differing)
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
