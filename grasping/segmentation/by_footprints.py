"""Objects of a loose cloud that nobody knows the viewpoint of: told apart by the places they stand on.

Seen along the table's normal, parts of one object that hide each other from the camera still touch, and neighbours a
gap apart do not. What touches or is stacked is one object.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from grasping.geometry.clustering import by_label, voxel_clusters
from grasping.segmentation.footprints import label_footprints
from grasping.segmentation.frame import Frame
from grasping.segmentation.object_rules import ObjectRules, Tabletop
from grasping.segmentation.rims import join_walls
from grasping.segmentation.saddles import parts_above_saddles

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

ENOUGH = 2000  # points of an object that suffice for its edges


def clusters_on_table(frame: Frame, chosen: IntArray, rules: ObjectRules, gap: float) -> list[IntArray]:
    """Points (M,) of each cluster of the chosen ones, which lie above the table, the largest first."""
    tabletop = rules.tabletop
    assert tabletop is not None
    labels = label_footprints(frame.points.take(chosen, axis=0) @ tabletop.level, gap, tabletop.pitch)
    frame.reject("points", "isolated", chosen[labels < 0])
    parts = [part for members in by_label(labels) for part in _parts(frame, chosen[members], rules, tabletop, gap)]
    firm = [part for part in parts if rules.too_little(part) is None and rules.misplaced(part) is None]
    others = [part for part in parts if not any(part is each for each in firm)]
    if len(firm) > 1:
        few = [points[:: max(1, len(points) // ENOUGH)] for points in firm]
        walls = [(frame.points.take(p, axis=0) @ tabletop.level, tabletop.heights.take(p)) for p in few]
        firm = [np.concatenate([firm[i] for i in numbers]) for numbers in join_walls(walls)]
    return sorted(firm + others, key=lambda points: -len(points))


def clusters_in_space(frame: Frame, chosen: IntArray, gap: float) -> list[IntArray]:
    """Points (M,) of each Euclidean cluster, the largest first."""
    labels = voxel_clusters(frame.points.take(chosen, axis=0).astype(np.float64), gap)
    return [chosen[members] for members in by_label(labels)]


def _parts(frame: Frame, points: IntArray, rules: ObjectRules, tabletop: Tabletop, gap: float) -> list[IntArray]:
    """A cluster as it is, or, where it is too large, by what it is above the feet of its parts."""
    # What is no object whatever its parts are is not taken apart.
    if rules.too_little(points) is not None or tabletop.beside(frame, points, share=1.0):
        return [points]
    least = max(rules.limits.min_points, round(len(points) * rules.limits.min_area / rules.area(points)))
    parts, done = [points], []
    while parts:
        part = parts.pop()
        group = None
        if rules.extent(part) > rules.limits.max_extent:
            flat = frame.points.take(part, axis=0) @ tabletop.level
            group = parts_above_saddles(flat, tabletop.heights.take(part), gap, tabletop.pitch, least)
        if group is None:
            done.append(part)
        else:
            parts += [part[each] for each in by_label(group)]
    return done
