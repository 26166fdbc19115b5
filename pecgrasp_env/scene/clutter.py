"""How densely objects lie: apart, close to each other, leaning against each other, in a pile, or in a bin."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pecgrasp_env.objects import ObjectModel
from pecgrasp_env.scene.piles import Bin, fill_bin, pile
from pecgrasp_env.scene.placement import PlacementError, Region, arrange, drop_each, move, outline_of, separation, turn
from pecgrasp_env.scene.settling import push_together

# And how many at most: more than eight do not fit side by side where the camera looks from its home posture.
MOST_OBJECTS = {"apart": 8, "close": 8, "touching": 8, "piled": 15, "bin": 15}
CLUTTERS = tuple(MOST_OBJECTS)
BIN = Bin()
CLOSE_GAP_M = (0.005, 0.02)
_TOUCHING_GAP_M = (0.002, 0.004)  # before they are pushed together
_STRIDE_M = 0.01
_BISECTIONS = 12
_CROWDS = 40
_SIDES = 12  # from which an object may be moved up until the crowd fits
_FEW = 5  # objects that find room in any order


def lay_out(
    models: Sequence[ObjectModel],
    rng: np.random.Generator,
    region: Region,
    clutter: str = "apart",
    clearance: float = 0.03,
) -> np.ndarray:
    """Poses (n, 7), world frame, in which the objects rest inside the region on z = 0 or on each other, or in the bin.

    Each object falls in a random orientation, so it may lie on any face it can lie on. By ``clutter``, it falls alone,
    and then they are
    - "apart": turned about the vertical and put anywhere, outlines at least ``clearance`` metres from each other;
    - "close": one after another moved up, from a random side, to those already there, until its outline is
      5 to 20 mm (uniform) from the nearest;
    - "touching": the same, then pushed together until each leans against another one, and come to rest again;
    or they fall one after another where they stay:
    - "piled": round one place of the table, each at rest on the table or on others, and touching another;
    - "bin": into `BIN`, wherever the region is.

    Outlines are the convex ones seen from above, so bodies are at least as far apart.

    Raises:
        PlacementError: an object never comes to rest, or the objects do not fit.
    """
    if clutter == "piled":
        return pile(models, rng, region)
    if clutter == "bin":
        return fill_bin(models, rng, BIN)
    resting = drop_each(models, rng)
    if clutter == "apart" or len(models) == 1:
        if len(models) <= _FEW:
            return arrange(models, resting, rng, region, clearance)
        # The large ones first: what is small still finds a gap between them.
        order = np.argsort([-np.prod(np.ptp(outline_of(m, p), axis=0)) for m, p in zip(models, resting, strict=True)])
        poses = np.empty_like(resting)
        poses[order] = arrange([models[k] for k in order], resting[order], rng, region, clearance)
        return poses
    outlines = [outline_of(model, pose) for model, pose in zip(models, resting, strict=True)]
    gaps = CLOSE_GAP_M if clutter == "close" else _TOUCHING_GAP_M
    by_size = sorted(range(len(models)), key=lambda k: -float(np.prod(np.ptp(outlines[k], axis=0))))
    for attempt in range(2 * _CROWDS):
        # As they come; where that never fits, the large ones first, each where the crowd grows least.
        dense = attempt >= _CROWDS
        places = _crowd(outlines, rng, gaps, region, by_size if dense else range(len(models)), dense)
        if places is None:
            continue
        poses = np.array([move(pose, yaw, at) for pose, (yaw, at) in zip(resting, places, strict=True)])
        if clutter == "close":
            return poses
        poses, at_rest, touching = push_together(models, poses)
        if at_rest.all() and touching.all() and _inside(models, poses, region):
            return poses
    names = ", ".join(model.instance for model in models)
    raise PlacementError(f"{len(models)} objects ({names}) do not fit in {region} with clutter={clutter!r}")


def _crowd(
    outlines: Sequence[np.ndarray],
    rng: np.random.Generator,
    gaps: tuple[float, float],
    region: Region,
    order: Sequence[int],
    dense: bool,
) -> list[tuple[float, np.ndarray]] | None:
    """Yaw and place (2,) of each outline (K, 2), each but the first moved up to the others; None: no room for one.

    The crowd grows round the origin and is then put somewhere in the region. order: in which they come. dense: of the
    sides from which each may come that is taken from which the crowd stays smallest, not the first that fits.
    """
    places: dict[int, tuple[float, np.ndarray]] = {}
    placed: list[np.ndarray] = []
    size = np.array([region.x_max - region.x_min, region.y_max - region.y_min])
    for k in order:
        best: tuple[float, float, np.ndarray] | None = None
        for _ in range(_SIDES):
            yaw = float(rng.uniform(-np.pi, np.pi))
            turned = turn(outlines[k], yaw)
            at = np.zeros(2)
            if placed:
                towards = np.mean([place for _, place in places.values()], axis=0)
                at = _move_up(turned, placed, towards, float(rng.uniform(-np.pi, np.pi)), float(rng.uniform(*gaps)))
            extent = np.ptp(np.concatenate([*placed, turned + at]), axis=0)
            if (extent <= size).all() and (best is None or extent.prod() < best[0]):
                best = (float(extent.prod()), yaw, at)
                if not dense:
                    break
        if best is None:
            return None
        places[k] = best[1:]
        placed.append(turn(outlines[k], best[1]) + best[2])
    points = np.concatenate(placed)
    free = size - np.ptp(points, axis=0)
    shift = np.array([region.x_min, region.y_min]) - points.min(axis=0) + rng.uniform(size=2) * free
    return [(places[k][0], places[k][1] + shift) for k in range(len(outlines))]


def _move_up(
    outline: np.ndarray, placed: Sequence[np.ndarray], anchor: np.ndarray, heading: float, gap: float
) -> np.ndarray:
    """The shift (2,) at which an outline that comes in towards the anchor is ``gap`` metres from the nearest one."""
    direction = np.array([np.cos(heading), np.sin(heading)])

    def clear(distance: float) -> bool:
        here = outline + anchor + distance * direction
        return all(separation(here, other) >= gap for other in placed)

    far = float(np.ptp(np.concatenate([*placed, outline]), axis=0).sum()) + np.ptp(outline, axis=0).sum() + gap
    while clear(far - _STRIDE_M):
        far -= _STRIDE_M
    near = far - _STRIDE_M
    for _ in range(_BISECTIONS):
        middle = (near + far) / 2
        near, far = (near, middle) if clear(middle) else (middle, far)
    return anchor + far * direction


def _inside(models: Sequence[ObjectModel], poses: np.ndarray, region: Region) -> bool:
    points = np.concatenate([outline_of(model, pose) + pose[:2] for model, pose in zip(models, poses, strict=True)])
    low, high = (region.x_min, region.y_min), (region.x_max, region.y_max)
    return bool((points >= low).all() and (points <= high).all())
