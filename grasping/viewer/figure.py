"""An interactive picture of clouds, regions and grasps, as HTML that needs nothing but a browser.

`fragment(...)` is one figure: drag to turn, wheel or pinch to zoom, point at something to read what it is, step
through the grasps. `grasping.viewer.html.page(title, body)` writes a page that holds any number of figures. Nothing is
fetched from anywhere, so the file can be mailed, archived and opened offline.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from grasping.errors import CloudError
from grasping.grasp import Grasp, GraspPlan
from grasping.gripper import ROBOTIQ_2F_140, Gripper
from grasping.viewer.encoding import (
    FIELD_OF_VIEW,
    disc_radius,
    eye_direction,
    fitting_distance,
    packed,
    rounded,
    thinned,
    unit_up,
)
from grasping.viewer.gripper_mesh import gripper_parts
from grasping.viewer.html import templates

_REGIONS = "Regions"
_PALETTE = ("2f7ed8", "e08a1e", "1fa187", "c2549d", "8a6fd1", "6b8e23", "d1603d", "4aa3a2")
_BEST_RGB, _WORST_RGB = (20, 160, 140), (226, 190, 84)
_REJECTED_RGB = (176, 128, 132)
_MOST_GRASPS = 20  # on a slider


@dataclass(frozen=True)
class Layer:
    """Points that share one colour and one label.

    points: (M, 3), metres, in the frame that all layers and the plan of a figure share. label: the first line that
    is shown on hover, and the legend's text. details: further lines. group: layers of one group are seen together,
    and a switch chooses between groups. rgb: its colour; None: one that differs from its neighbours'. grasp: where a
    figure has no plan, the gripper is drawn at the grasps of its layers, the best first.
    """

    points: np.ndarray
    label: str
    details: tuple[str, ...] = ()
    group: str = "Objects"
    rgb: tuple[int, int, int] | None = None
    grasp: Grasp | None = None
    framed: bool = True


def score_rgb(score: float | None) -> tuple[int, int, int]:
    """The colour of a score in [0, 1]; None: there is no grasp."""
    if score is None:
        return _REJECTED_RGB
    quality = min(max(score, 0.0), 1.0)
    red, green, blue = (round(w + quality * (b - w)) for w, b in zip(_WORST_RGB, _BEST_RGB, strict=True))
    return red, green, blue


def fragment(
    plan: GraspPlan | None = None,
    cloud: np.ndarray | None = None,
    *,
    gripper: Gripper = ROBOTIQ_2F_140,
    layers: Sequence[Layer] = (),
    up: Sequence[float] | np.ndarray | None = None,
    max_points: int = 20_000,
) -> str:
    """One figure as HTML, to be placed in the body of a `page`.

    plan: its regions are coloured by score and its candidates, best first, carry the gripper drawn to scale.
    cloud: (N, 3) metres, the surroundings, drawn in grey; rows with NaN are left out. layers: labelled clouds, such
    as classified objects. up: (3,) unit vector away from the table in the cloud's frame; None: the frame is a
    camera's, and up is its -y. max_points: larger clouds are thinned evenly to as many points.

    Raises CloudError where there is nothing to draw or an array is not (N, 3).
    """
    up_axis = unit_up(up)
    entries: list[dict[str, Any]] = []
    shapes: list[np.ndarray] = []
    around: list[bool] = []  # of each shape, whether it only surrounds the others
    if plan is not None:
        for index, region in enumerate(plan.regions):
            points = _points(region.points, f"plan.regions[{index}].points")
            entries.append(_region_entry(plan, index))
            shapes.append(points)
            around.append(False)
    for index, layer in enumerate(layers):
        shapes.append(_points(layer.points, f"layers[{index}].points"))
        around.append(not layer.framed)
        text = [layer.label, *layer.details]
        rgb = list(layer.rgb or bytes.fromhex(_PALETTE[index % len(_PALETTE)]))
        score = "" if layer.grasp is None else f" {layer.grasp.score:.2f}"
        entries.append({"group": layer.group, "rgb": rgb, "text": text, "legend": layer.label + score})
    if cloud is not None:
        shapes.append(_points(cloud, "cloud"))
        around.append(True)
        entries.append({"group": None, "rgb": None, "text": []})
    if not any(len(shape) for shape in shapes):
        raise CloudError("nothing to draw: plan, cloud and layers hold no finite point")

    subject = [shape for shape, beside in zip(shapes, around, strict=True) if len(shape) and not beside]
    steps = _steps(plan, layers)[:_MOST_GRASPS]
    grasps, parts, drawn = _grasps(steps, gripper)
    extent = np.concatenate([*(subject or shapes), *drawn])
    target = (extent.min(axis=0) + extent.max(axis=0)) / 2
    radius = float(np.linalg.norm(extent - target, axis=1).max()) or 0.05
    eye = eye_direction(plan.best if plan is not None else None, target, up_axis)
    # What it is about keeps its points as far as they fit; what is around it gets what is left.
    n_subject = sum(map(len, subject))
    share = min(1.0, 0.8 * max_points / max(1, n_subject))
    sizes = [len(shape) for shape, beside in zip(shapes, around, strict=True) if beside]
    left = iter(_in_parts(sizes, max_points - round(share * n_subject)))
    for entry, shape, beside in zip(entries, shapes, around, strict=True):
        shown = thinned(shape, next(left) if beside else max(1, round(share * len(shape))))
        entry.update(packed(shown), radius=disc_radius(shown, radius))
    largest = max(
        (entry["radius"] for entry, beside in zip(entries, around, strict=True) if not beside), default=radius
    )
    for entry in entries:
        entry["radius"] = min(entry["radius"], 2 * largest)  # lone points around are no balls
    groups = list(dict.fromkeys(entry["group"] for entry in entries if entry["group"] is not None))
    data = {
        "layers": entries,
        "grasps": grasps,
        "gripper": parts,
        "group": groups[0] if groups else None,
        "up": rounded(up_axis),
        "eye": rounded(eye),
        "distance": round(fitting_distance(extent - target, eye, up_axis), 5),
        "field_of_view": FIELD_OF_VIEW,
        "target": rounded(target),
        "radius": round(radius, 5),
    }
    legends = {group: _legend(group, entries, plan) for group in groups}
    return templates("grasping.viewer").get_template("figure.html").render(data=data, legends=legends)


def _in_parts(sizes: Sequence[int], most: int) -> list[int]:
    """How many of so many points each keeps: equal parts, and what small ones leave goes to larger ones."""
    kept = [0] * len(sizes)
    for done, index in enumerate(sorted(range(len(sizes)), key=lambda index: sizes[index])):
        kept[index] = min(sizes[index], (most - sum(kept)) // (len(sizes) - done))
    return kept


class _LegendItem(NamedTuple):
    """A CSS colour, or a ramp of them, and the words on its sides."""

    colour: str
    before: str = ""
    after: str = ""
    ramp: bool = False


def _legend(group: str, entries: list[dict[str, Any]], plan: GraspPlan | None) -> list[_LegendItem]:
    """A plan's regions are explained by their scores, whatever else there is by its label."""
    if group != _REGIONS or plan is None:
        mine = [entry for entry in entries if entry["group"] == group]
        return [_LegendItem(f"rgb{tuple(entry['rgb'])}", after=entry["legend"]) for entry in mine]
    scores = [grasp.score for grasp in plan.candidates]
    items = []
    if len(scores) > 1:
        ramp = f"linear-gradient(90deg,rgb{_WORST_RGB},rgb{_BEST_RGB})"
        items.append(_LegendItem(ramp, f"score {scores[-1]:.3g} ", f"{scores[0]:.3g}", ramp=True))
    elif scores:
        items.append(_LegendItem(f"rgb{_BEST_RGB}", after="candidate"))
    if any(entry["group"] == _REGIONS and entry["rgb"] == list(_REJECTED_RGB) for entry in entries):
        items.append(_LegendItem(f"rgb{_REJECTED_RGB}", after="not grasped"))
    return items


def _region_entry(plan: GraspPlan, index: int) -> dict[str, Any]:
    region = plan.regions[index]
    text = [
        f"region {index}: {region.primitive}",
        str(region.verdict),
        f"width {1000 * region.width:.0f} mm",
        f"lateral curvature {region.curvature:.4f}",
    ]
    scores = [grasp.score for grasp in plan.candidates]
    rank = next((k for k, grasp in enumerate(plan.candidates) if grasp.region == index), None)
    rgb: Sequence[int] = _REJECTED_RGB
    if rank is not None:
        text.insert(2, f"rank {rank + 1} of {len(scores)}, score {scores[rank]:.3g}")
        span = scores[0] - scores[-1]
        quality = (scores[rank] - scores[-1]) / span if span else 1.0
        rgb = score_rgb(quality)
    elif any(grasp.kind == "primitive" for grasp in plan.candidates):
        rgb = _BEST_RGB  # the whole object is one primitive: every region of it is grasped
    return {"group": _REGIONS, "rgb": list(rgb), "text": text}


class _Step(NamedTuple):
    """A place of the slider: the grasp, the index of the layer that it holds, and what is said of it."""

    grasp: Grasp
    layer: int | None
    text: list[str]


def _steps(plan: GraspPlan | None, layers: Sequence[Layer]) -> list[_Step]:
    if plan is not None:
        return [
            _Step(each, each.region, _words(each, "whole object" if each.region is None else f"region {each.region}"))
            for each in plan.candidates
        ]
    held = [
        _Step(layer.grasp, k, _words(layer.grasp, layer.label))
        for k, layer in enumerate(layers)
        if layer.grasp is not None
    ]
    return sorted(held, key=lambda step: -step.grasp.score)


def _grasps(steps: Sequence[_Step], gripper: Gripper) -> tuple[list, list, list[np.ndarray]]:
    """Each step with each gripper part's pose, the parts, and the first grasp's vertices in the cloud's frame."""
    grasps: list[dict[str, Any]] = []
    shapes: list[dict[str, Any]] = []
    drawn: list[np.ndarray] = []
    for grasp, layer, text in steps:
        parts = gripper_parts(gripper, grasp.width)
        poses = [np.asarray(grasp.pose) @ part.T_grasp_part for part in parts]
        terms = [f"{name} {value:.3g}" for name, value in grasp.terms.items()]
        flat = [rounded(pose[:3]) for pose in poses]
        grasps.append({"poses": flat, "layer": None if layer is None else int(layer), "text": text, "terms": terms})
        if not shapes:
            shapes = [
                {"vertices": rounded(part.vertices), "faces": part.faces.ravel().tolist(), "rgb": list(part.rgb)}
                | {"text": [f"{gripper.name}: {part.name}"]}
                for part in parts
            ]
            drawn = [part.vertices @ pose[:3, :3].T + pose[:3, 3] for part, pose in zip(parts, poses, strict=True)]
    return grasps, shapes, drawn


def _words(grasp: Grasp, where: str) -> list[str]:
    return [where, f"width {1000 * grasp.width:.0f} mm", f"score {grasp.score:.3g}"]


def _points(points: np.ndarray, name: str) -> np.ndarray:
    array = np.asarray(points, dtype=np.float64)
    if array.ndim != 2 or array.shape[1] != 3:
        raise CloudError(f"{name} must have shape (N, 3), not {array.shape}")
    return array[np.isfinite(array).all(axis=1)]
