"""The data card: what a data set holds and how it was made, as one HTML file that loads nothing from elsewhere.

It shows counts, rejected draws, histograms, and random clouds of each class as the camera saw them: a data set should
be looked at before anything is trained on it.
"""

from __future__ import annotations

import json
import os
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from pec.common.atomic_files import write_whole
from pec.data.shards import Manifest, Shard, read_manifest, read_shard
from pec.data.splits import read_splits
from pec.experiments.chart_files import inline_svg
from pec.experiments.charts import histogram, number
from pecgrasp_env.common.cloud_image import cloud_image
from pecgrasp_env.common.html_report import Tile, report_page
from pecgrasp_env.objects import UNKNOWN

__all__ = ["CARD_NAME", "write_card"]

CARD_NAME = "card.html"
_SHOWN = 16  # clouds of a class


def write_card(directory: str | os.PathLike[str]) -> Path:
    """Write DIR/card.html of a complete data set, whole or not at all; the same data set gives the same bytes.

    Raises DatasetError where there is none.
    """
    directory = Path(directory)
    manifest = read_manifest(directory)
    shards = [read_shard(directory / record.file) for record in manifest.shards]
    path = directory / CARD_NAME
    write_whole(path, _render(directory, manifest, shards))
    return path


def _render(directory: Path, manifest: Manifest, shards: Sequence[Shard]) -> str:
    n_samples = sum(map(len, shards))
    counts = sum((Counter(record.rejected) for record in manifest.shards), Counter[str]())
    skipped = {name: why for record in manifest.shards for name, why in record.skipped.items()}
    splits = read_splits(directory, n_samples)
    return report_page(
        "pecgrasp_env.capture",
        "data_card",
        f"Data card: {_of_classes(manifest)}, {n_samples:,} clouds",
        manifest=manifest,
        introduction=_introduction(manifest),
        summary=_tiles(manifest, shards),
        classes=_classes(manifest, shards),
        histograms=_histograms(manifest, shards),
        contact_sheet=_contact_sheet(manifest, shards),
        rejected=[(reason, f"{count:,}") for reason, count in counts.most_common()],
        skipped=list(skipped.items()),
        splits=[(name, f"{int((~test).sum()):,}", f"{int(test.sum()):,}") for name, test in splits.items()],
        cameras=_cameras(manifest),
        configuration=json.dumps(manifest.config, indent=1),
    )


def _of_classes(manifest: Manifest) -> str:
    """How many classes, and whether there are strangers besides."""
    known = [name for name in manifest.classes if name != UNKNOWN]
    return f"{len(known)} classes" + (" and strangers" if len(known) < len(manifest.classes) else "")


def _introduction(manifest: Manifest) -> str:
    on_a_stand = manifest.config.get("tabletop", {}).get("free_views", 0)
    seen = {0: "its wrist camera from where the policy looks", 1: "a camera on a stand"}.get(
        on_a_stand, "its wrist camera from where the policy looks, and by a camera on a stand"
    )
    scenario = {
        "free": "Each object floats alone before a depth camera, in any pose",
        "tabletop": f"Objects lie as they fell on the robot's table, seen by {seen}, and cut out by the segmentation "
        "that runs on the robot",
        "piled": f"Objects lie on the robot's table as they fell onto each other, seen by {seen}, and cut out, with "
        "all faults, by the segmentation that runs on the robot",
        "surface": "Points from all over each mesh, without a camera, scaled to the unit sphere",
    }[manifest.config.get("scenario", "free")]
    sensor = {
        "ideal": "an ideal sensor",
        "d435": "a simulated RealSense D435 with its faults",
        "structured_light": "a simulated structured-light camera (Kinect, Xtion) with its faults",
    }.get(manifest.config.get("sensor", ""), "no sensor")
    strangers = (
        f" Class {UNKNOWN!r} holds things that are of none of the others." if UNKNOWN in manifest.classes else ""
    )
    return f"{scenario}; {sensor}. Every cloud was labelled by the simulator, none by hand.{strangers}"


def _tiles(manifest: Manifest, shards: Sequence[Shard]) -> list[Tile]:
    n_points = _each(shards, lambda shard: np.diff(shard.offsets))
    seen = {int(i) for shard in shards for i in shard.instance_index}
    median = Tile(f"{np.median(n_points):,.0f}", ("points of a cloud, median",)) if len(n_points) else None
    megabytes = sum(shard.points.nbytes for shard in shards) / 1e6
    return [
        Tile(f"{len(n_points):,}", ("labelled clouds",)),
        Tile(str(sum(name != UNKNOWN for name in manifest.classes)), (_of_classes(manifest).partition(" ")[2],)),
        Tile(f"{len(seen):,}", ("objects",)),
        median or Tile("–", ("points of a cloud",)),
        Tile(f"{megabytes:,.0f} MB" if megabytes >= 10 else f"{number(megabytes)} MB", ("of points, memory-mapped",)),
    ]


def _classes(manifest: Manifest, shards: Sequence[Shard]) -> list[tuple[str, list[str], str]]:
    """Name, numbers and origins of each class."""
    labels = _each(shards, lambda shard: shard.class_index)
    n_points = _each(shards, lambda shard: np.diff(shard.offsets))
    distance = _each(shards, _distances)
    rows = []
    for index, name in enumerate(manifest.classes):
        here = labels == index
        instances = [instance for instance in manifest.instances if instance["class"] == name]
        origins = ", ".join(sorted({instance.get("origin", "") for instance in instances}))
        numbers = ["–", "–"]
        if here.any():
            low, median, high = np.percentile(n_points[here], (5, 50, 95))
            numbers = [f"{low:,.0f} – {median:,.0f} – {high:,.0f}", f"{np.median(distance[here]):.2f}"]
        cells = [str(len(instances)), f"{int(here.sum()):,}", *numbers]
        rows.append((name, cells, origins if len(origins) < 90 else f"{origins[:90]}…"))
    return rows


def _histograms(manifest: Manifest, shards: Sequence[Shard]) -> list[tuple[str, str]]:
    """Caption and SVG of each."""
    charts = [("Points of a cloud", _each(shards, lambda shard: np.diff(shard.offsets)), "", True)]
    if manifest.config.get("scenario") != "surface":
        charts.append(("Distance from the camera to the object's origin", _each(shards, _distances), "m", False))
        charts.append(
            (
                "View angle: between the line of sight and the object's z axis; 0° is from above",
                _each(shards, _angles),
                "°",
                False,
            )
        )
    if manifest.config.get("scenario") in ("tabletop", "piled"):
        hidden = 100 * _each(shards, lambda shard: shard.occlusion)
        caption = f"Hidden by others: {np.mean(hidden > 0):.1%} of the clouds are, by so much"
        charts.append((caption, hidden[hidden > 0], "%", False))
    return [(caption, inline_svg(histogram(values, unit, log), caption)) for caption, values, unit, log in charts]


def _contact_sheet(manifest: Manifest, shards: Sequence[Shard]) -> list[tuple[str, list[tuple[str, str]]]]:
    """Each class with the captions and the addresses of its images."""
    places = [(shard, i) for shard in shards for i in range(len(shard))]
    labels = _each(shards, lambda shard: shard.class_index)
    rng = np.random.default_rng(manifest.seed)
    sections = []
    for index, name in enumerate(manifest.classes):
        members = np.flatnonzero(labels == index)
        images = []
        for sample in np.sort(rng.permutation(members)[:_SHOWN]).tolist():
            shard, i = places[sample]
            cloud = shard.cloud(i)
            instance = manifest.instances[int(shard.instance_index[i])]["name"]
            images.append((f"sample {sample}: {instance}, {len(cloud):,} points", _image(cloud, manifest)))
        sections.append((name, images))
    return sections


def _image(cloud: np.ndarray, manifest: Manifest) -> str:
    """A cloud (N, 3) as the address of an image."""
    points = cloud.astype(float)
    if manifest.config.get("scenario") == "surface":  # no camera: from the front, a little from above
        points = points @ np.array([[1, 0, 0], [0, 0.5, -0.87], [0, -0.87, -0.5]]).T + (0, 0, 4)
    return cloud_image(points)


def _cameras(manifest: Manifest) -> list[tuple[str, str, str, str]]:
    """Name, pixels, focal length and minimum depth; nothing where clouds were drawn without a camera."""
    return [
        (camera["name"], f"{camera['width']}×{camera['height']}", f"{camera['fx']:.1f}", f"{camera['min_depth']:g}")
        for camera in manifest.cameras
        if "fx" in manifest.cameras[0]
    ]


def _each(shards: Sequence[Shard], of: Any) -> np.ndarray:
    """`of` each shard, one after the other."""
    return np.concatenate([np.zeros(0), *(np.asarray(of(shard), float) for shard in shards)])


def _distances(shard: Shard) -> np.ndarray:
    """(n,) m from the camera to the object's origin."""
    return np.linalg.norm(shard.T_camera_object[:, :3, 3], axis=1)


def _angles(shard: Shard) -> np.ndarray:
    """(n,) degrees between the direction from the object to the camera and the object's z axis."""
    position = shard.T_camera_object[:, :3, 3]
    distance = np.maximum(np.linalg.norm(position, axis=1), 1e-9)
    cosine = -np.einsum("ij,ij->i", shard.T_camera_object[:, :3, 2], position) / distance
    return np.degrees(np.arccos(np.clip(cosine, -1, 1)))
