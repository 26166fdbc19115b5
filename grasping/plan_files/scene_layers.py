"""A scene as it was cut: each object, the table, what was left out and why, and cuts that are not sure, in colours."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from grasping.cloud_files import valid_points
from grasping.plan_files.left_out import kinds_left_out, of_cut, of_kind, unsure_cuts
from grasping.segmentation.scene import Cut, Scene
from grasping.viewer.figure import Layer

# Objects are blue to green and what was left out is red to brown, so that no two meanings look alike.
_OBJECTS = ("2f7ed8", "1fa187", "8a6fd1", "6b8e23", "4aa3a2", "5b6abf", "3f8f4f", "7fb2e5")
_LEFT_OUT = ("c62828", "e07b5a", "8e1e4f", "b5651d", "d46a92", "7a3b2e")
_TABLE, _UNSURE = "d3ccbf", "ffc400"
_ADJOINING = 0.015  # m; of two objects that a cut divides the points this near to the other one show where it is


def scene_layers(cloud: NDArray, scene: Scene) -> list[Layer]:
    """cloud: (N, 3), the segmenter's input, flattened; what was not measured is not drawn."""
    objects = [_of_object(scene, k) for k in range(len(scene.objects))]
    cuts = [_of_cut(scene, cut) for cut in unsure_cuts(scene)]
    table = [] if scene.plane is None else [_of_table(cloud, scene)]
    layers = [*cuts, *objects, *_of_left_out(cloud, scene), *table]
    return [layer for layer in layers if len(layer.points)]


def _of_object(scene: Scene, k: int) -> Layer:
    details = [f"{len(scene.objects[k]):,} points"]
    if scene.confidence:
        details.append(f"confidence {scene.confidence[k]:.2f}")
    if scene.touches_border[k]:
        details.append("cut off by the edge of the image")
    return _layer(scene.objects[k], f"object {k + 1}", _OBJECTS[k % len(_OBJECTS)], *details, framed=True)


def _of_cut(scene: Scene, cut: Cut) -> Layer:
    """Of both objects the points that are near the other one."""
    one, other = (np.asarray(scene.objects[k], dtype=np.float64) for k in (cut.first, cut.second))
    from_one, from_other = cKDTree(other).query(one)[0], cKDTree(one).query(other)[0]
    reach = max(_ADJOINING, 1.01 * float(from_one.min()))
    border = np.concatenate([one[from_one <= reach], other[from_other <= reach]])
    return _layer(border, f"not sure: {of_cut(cut)}", _UNSURE, framed=True)


def _of_left_out(cloud: NDArray, scene: Scene) -> list[Layer]:
    """One for each kind of thing, the largest first; what the gripper keeps clear of says so."""
    kinds, rest = kinds_left_out(scene)
    avoided = {tuple(points[0]) for points in scene.obstacles}
    layers = []
    for number, kind in enumerate([*kinds, *([each] for each in rest)]):
        clusters = [each.indices for each in kind if len(each.indices)]
        points = np.concatenate([cloud[:0], *(cloud[index] for index in clusters)])
        obstacles = sum(tuple(cloud[index[0]]) in avoided for index in clusters)
        details = [f"the gripper keeps clear of {obstacles} of {len(kind)}"] if obstacles else []
        said = of_kind(kind) if number < len(kinds) else f"left out: {kind[0].n_points:,} points {kind[0].why}"
        layers.append(_layer(valid_points(points), said, _LEFT_OUT[number % len(_LEFT_OUT)], *details))
    return layers


def _of_table(cloud: NDArray, scene: Scene) -> Layer:
    rest = np.ones(len(cloud), dtype=bool)
    for index in (*scene.indices, *(each.indices for each in scene.rejected)):
        rest[index] = False
    return _layer(valid_points(cloud[rest]), f"table, {scene.n_table:,} points", _TABLE)


def _layer(points: NDArray, label: str, colour: str, *details: str, framed: bool = False) -> Layer:
    red, green, blue = bytes.fromhex(colour)
    return Layer(points, label, details, rgb=(red, green, blue), framed=framed)
