"""The data card: what a data set holds and how it was made, as one HTML file that loads nothing from elsewhere.

It shows counts, rejected draws, histograms, and random clouds of each class as the camera saw them: a data set should
be looked at before anything is trained on it.
"""

from __future__ import annotations

import base64
import html
import io
import json
import os
from collections import Counter
from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from grasping.viewer.html import page
from pec.common.atomic_files import write_whole
from pec.data.shards import Manifest, Shard, read_manifest, read_shard
from pec.data.splits import read_splits
from pec.experiments.chart_files import inline_svg
from pec.experiments.charts import histogram

__all__ = ["CARD_NAME", "write_card"]

CARD_NAME = "card.html"
_SHOWN = 16  # clouds of a class
_SIDE = 112  # pixels of a picture
_NEAR, _FAR = np.array([8, 126, 164]), np.array([168, 196, 206])  # to be seen on white and on black


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
    title = f"Data card: {len(manifest.classes)} classes, {sum(map(len, shards)):,} clouds"
    style = (files("pecgrasp_env.common") / "report.css").read_text(encoding="utf-8") + _STYLE
    body = [
        f"<header><h1>{_esc(title)}</h1><p>{_esc(_introduction(manifest))}</p></header>",
        _tiles(manifest, shards),
        _classes(manifest, shards),
        _histograms(manifest, shards),
        _contact_sheet(manifest, shards),
        _rejected(manifest),
        _making(directory, manifest, sum(map(len, shards))),
    ]
    return page(title, "\n".join(part for part in body if part), style=style)


_STYLE = """
.sheet { display: flex; flex-wrap: wrap; gap: 0.3rem; margin: 0.3rem 0 1.2rem; }
.sheet img { width: 7rem; height: 7rem; border: 1px solid var(--line); border-radius: 8px; background: var(--panel); }
h3 { margin: 1rem 0 0.2rem; font-size: 1rem; }
"""


def _introduction(manifest: Manifest) -> str:
    scenario = {
        "free": "Each object floats alone before a depth camera, in any pose",
        "tabletop": "Objects lie as they fell on the robot's table, seen by its wrist camera from where the policy "
        "looks, and cut out by the segmentation that runs on the robot",
        "surface": "Points from all over each mesh, without a camera, scaled to the unit sphere",
    }[manifest.config.get("scenario", "free")]
    sensor = {
        "ideal": "an ideal sensor",
        "d435": "a simulated RealSense D435 with its faults",
    }.get(manifest.config.get("sensor", ""), "no sensor")
    return f"{scenario}; {sensor}. Every cloud was labelled by the simulator, none by hand."


def _tiles(manifest: Manifest, shards: Sequence[Shard]) -> str:
    n_points = _each(shards, lambda shard: np.diff(shard.offsets))
    seen = {int(i) for shard in shards for i in shard.instance_index}
    tiles = [
        (f"{len(n_points):,}", "labelled clouds"),
        (str(len(manifest.classes)), "classes"),
        (f"{len(seen):,}", "objects"),
        (f"{np.median(n_points):,.0f}", "points of a cloud, median") if len(n_points) else ("–", "points of a cloud"),
        (f"{sum(shard.points.nbytes for shard in shards) / 1e6:,.0f} MB", "of points, memory-mapped"),
    ]
    inner = "".join(f'<div class="tile"><b>{value}</b><span>{note}</span></div>' for value, note in tiles)
    return f'<div class="tiles">{inner}</div>'


def _classes(manifest: Manifest, shards: Sequence[Shard]) -> str:
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
        rows.append((name.replace("_", " "), cells, origins if len(origins) < 90 else f"{origins[:90]}…"))
    head = ("class", "objects", "clouds", "points, 5 – 50 – 95 %", "distance, median, m", "from")
    body = "".join(
        f"<tr><td>{_esc(name)}</td>"
        + "".join(f'<td class="right">{cell}</td>' for cell in cells)
        + f"<td>{_esc(origin)}</td></tr>"
        for name, cells, origin in rows
    )
    columns = "".join(f"<th{'' if k in (0, 5) else ' class=right'}>{_esc(text)}</th>" for k, text in enumerate(head))
    table = f"<table><thead><tr>{columns}</tr></thead><tbody>{body}</tbody></table>"
    return f'<h2>Classes</h2><div class="scroll">{table}</div>'


def _histograms(manifest: Manifest, shards: Sequence[Shard]) -> str:
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
    if manifest.config.get("scenario") == "tabletop":
        hidden = 100 * _each(shards, lambda shard: shard.occlusion)
        caption = f"Hidden by others: {np.mean(hidden > 0):.1%} of the clouds are, by so much"
        charts.append((caption, hidden[hidden > 0], "%", False))
    figures = "".join(
        f"<figure><figcaption>{_esc(caption)}</figcaption>{inline_svg(histogram(values, unit, log), caption)}</figure>"
        for caption, values, unit, log in charts
        if len(values)
    )
    return f'<h2>Distributions</h2><div class="charts">{figures}</div>'


def _contact_sheet(manifest: Manifest, shards: Sequence[Shard]) -> str:
    places = [(shard, i) for shard in shards for i in range(len(shard))]
    labels = _each(shards, lambda shard: shard.class_index)
    rng = np.random.default_rng(manifest.seed)
    sections = []
    for index, name in enumerate(manifest.classes):
        members = np.flatnonzero(labels == index)
        chosen = np.sort(rng.permutation(members)[:_SHOWN])
        pictures = []
        for sample in chosen.tolist():
            shard, i = places[sample]
            cloud = shard.cloud(i)
            instance = manifest.instances[int(shard.instance_index[i])]["name"]
            words = _esc(f"sample {sample}: {instance}, {len(cloud):,} points")
            pictures.append(f'<img alt="{words}" title="{words}" src="{_picture(cloud, manifest)}">')
        sections.append(f'<h3>{_esc(name.replace("_", " "))}</h3><div class="sheet">{"".join(pictures)}</div>')
    note = "Random clouds of each class as the camera saw them, each filling its picture; near points are dark."
    return f"<h2>Contact sheet</h2><p>{note}</p>{''.join(sections)}"


def _picture(cloud: np.ndarray, manifest: Manifest) -> str:
    """A cloud (N, 3) of the camera frame in perspective, shaded by depth, as the data of a transparent PNG."""
    points = cloud.astype(float)
    if manifest.config.get("scenario") == "surface":  # no camera: from the front, a little from above
        points = points @ np.array([[1, 0, 0], [0, 0.5, -0.87], [0, -0.87, -0.5]]).T + (0, 0, 4)
    flat = points[:, :2] / points[:, 2:]
    low, high = flat.min(axis=0), flat.max(axis=0)
    size = max(float((high - low).max()), 1e-9)
    at = ((flat - (low + high) / 2) / size * (_SIDE - 12) + _SIDE / 2).astype(int)
    depth = points[:, 2]
    far = (depth - depth.min()) / max(float(np.ptp(depth)), 1e-9)
    picture = np.zeros((_SIDE, _SIDE, 4), np.uint8)
    reach = int(np.clip(np.ceil(0.5 * _SIDE / np.sqrt(len(points))), 1, 6))  # few points are drawn larger
    for index in np.argsort(-depth):  # near ones over far ones
        column, row = at[index]
        area = picture[max(row - reach, 0) : row + reach, max(column - reach, 0) : column + reach]
        area[...] = (*(_NEAR + far[index] * (_FAR - _NEAR)).astype(int), 255)
    buffer = io.BytesIO()
    Image.fromarray(picture).quantize(32).save(buffer, "PNG", optimize=True)
    return f"data:image/png;base64,{base64.b64encode(buffer.getvalue()).decode()}"


def _rejected(manifest: Manifest) -> str:
    counts = sum((Counter(record.rejected) for record in manifest.shards), Counter[str]())
    skipped = {name: why for record in manifest.shards for name, why in record.skipped.items()}
    if not counts and not skipped:
        return "<h2>What was not kept</h2><p>Nothing: every draw gave a cloud.</p>"
    rows = [(reason, f"{count:,}") for reason, count in counts.most_common()]
    text = _table(("draws that gave no cloud", "count"), rows) if rows else ""
    if skipped:
        text += _table(("object that was skipped", "why"), list(skipped.items()))
    return f"<h2>What was not kept</h2>{text}"


def _making(directory: Path, manifest: Manifest, n_samples: int) -> str:
    parts = [_table(("made by", "version"), list(manifest.generator.items()))]
    splits = read_splits(directory, n_samples)
    if splits:
        rows = [(name, f"{int((~test).sum()):,}", f"{int(test.sum()):,}") for name, test in splits.items()]
        parts.append(_table(("stored split", "train", "test"), rows))
    if manifest.cameras and "fx" in manifest.cameras[0]:
        cameras = [
            (camera["name"], f"{camera['width']}×{camera['height']}", f"{camera['fx']:.1f}", f"{camera['min_depth']:g}")
            for camera in manifest.cameras
        ]
        parts.append(_table(("camera", "pixels", "focal length, pixels", "minimum depth, m"), cameras))
    configuration = _esc(json.dumps(manifest.config, indent=1))
    parts.append(f"<details><summary>Configuration</summary><pre>{configuration}</pre></details>")
    load = "from pec.data.dataset import load_dataset\ndataset = load_dataset(DIR)  # clouds, labels, instances, splits"
    parts.append(f"<pre>{_esc(load)}</pre>")
    return f"<h2>How it was made</h2>{''.join(parts)}"


def _table(head: Sequence[str], rows: Sequence[Sequence[Any]]) -> str:
    columns = "".join(f"<th>{_esc(text)}</th>" for text in head)
    body = "".join("<tr>" + "".join(f"<td>{_esc(cell)}</td>" for cell in row) + "</tr>" for row in rows)
    return f'<div class="scroll"><table><thead><tr>{columns}</tr></thead><tbody>{body}</tbody></table></div>'


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


def _esc(text: object) -> str:
    return html.escape(str(text))
