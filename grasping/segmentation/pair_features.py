"""What is known of a pair of patches, as numbers from which trees tell whether they are of one object."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from grasping.segmentation import kernels
from grasping.segmentation.patch_measures import PatchSums, extents, fit_quadratics, in_order, measures_of
from grasping.segmentation.patch_pairs import IN_FRONT, Borders
from grasping.segmentation.surface_fits import SurfaceFits

FloatArray = NDArray[np.float64]
Float32Array = NDArray[np.float32]
IntArray = NDArray[np.int64]

QUANTILES = (0.1, 0.25, 0.5, 0.75, 0.9)
INNER = 2  # pixels from the border into a patch, where its plane is its own
MOST_JUMP = 0.3  # 1/m

AT_BORDER = (
    [f"jump_{round(100 * share)}" for share in QUANTILES]  # 1/m, + where the smaller patch is nearer
    + [f"turn_{round(100 * share)}" for share in QUANTILES]  # chord of the normals' angle, + where convex
    + [f"size_of_jump_{round(100 * share)}" for share in QUANTILES]
    + ["gap_10", "gap_50"]  # m between the pixels
    + ["height_10", "height_90"]  # m of the border above the table
    + ["level", "smaller_in_front", "larger_in_front"]  # share of the border
    + ["steps", "adjoining", "along_row"]
    + ["length", "share_of_smaller", "share_of_larger"]  # m, and of their outlines
    + ["up_at_border", "up_apart"]  # of the normals' part along the table's
)
OF_BOTH = (
    ["behind_one", "at_hole"]
    + [
        f"{fit}_{which}"
        for fit in ("plane", "quadric")
        for which in ("smaller", "larger", "both", "more", "off", "off_mean")
    ]
    + ["angle", "spread_smaller", "spread_larger", "up_smaller", "up_larger"]
    + [
        f"height_{name}"
        for name in ("5_s", "5_l", "50_s", "50_l", "95_s", "95_l", "tops", "feet", "s_over_l", "l_over_s")
    ]
    + [f"{name}_{which}" for name in ("table", "stands", "nothing", "image", "edge", "area") for which in ("s", "l")]
    + ["ratio", "pixels", "distance", "above", "beside"]
    + [f"extent_{axis}_{which}" for axis in range(3) for which in ("s", "l", "both")]
    + ["convex_s", "convex_l"]
)
NAMES = (*AT_BORDER, *OF_BOTH)

BEHIND = 0.05  # m along all of the border from one to the other, and
ON_ONE_LEVEL = 0.1  # of the border at most on which neither is in front of the other
ADJOINING = 0.1  # of the smaller one's outline, at least: more than a corner
STANDS, UPRIGHT = 0.03, 0.03  # of either's outline low on the table, and m that either is high
SHOWN = 100  # pixels of the smaller one, fewer of which do not show that it stands


def border_features(
    found: Borders,
    fits: SurfaceFits,
    positions: Float32Array,
    labels: NDArray[np.int32],
    height: Float32Array,
    up: FloatArray | None,
    patches: PatchSums,
) -> tuple[Float32Array, IntArray]:
    """(P, len(AT_BORDER)) of the pairs that adjoin, and (2, P) how many pixel pairs show the first and the second in
    front.
    """
    count = len(found.first)
    if kernels.compiled is None or not count:
        return border_features_reference(found, fits, positions, labels, height, up, patches)
    features, in_front = np.empty((count, len(AT_BORDER)), dtype=np.float32), np.empty((2, count), dtype=np.int64)
    surface = (fits.inverse_depth, fits.slopes, fits.normals, positions, height, labels, up)
    pixels = (found.inner, found.outer, found.steps, found.along_row, found.forward)
    pairs = (found.start, found.first, found.second, found.adjoining, patches.sums, patches.sides)
    kernels.compiled.describe_borders(*surface, *pixels, *pairs, features, in_front)
    return features, in_front


def border_features_reference(
    found: Borders,
    fits: SurfaceFits,
    positions: Float32Array,
    labels: NDArray[np.int32],
    height: Float32Array,
    up: FloatArray | None,
    patches: PatchSums,
) -> tuple[Float32Array, IntArray]:
    """`border_features` in NumPy."""
    h, w = labels.shape
    flat = labels.ravel()
    count = len(found.first)
    pair = np.repeat(np.arange(count), np.diff(found.start))
    sizes = np.diff(found.start)
    inner = _inward(flat, found.inner, np.where(found.along_row, 1, w) * -found.forward, found.along_row, h, w)
    outer = _inward(flat, found.outer, np.where(found.along_row, 1, w) * found.forward, found.along_row, h, w)
    jump = np.clip(_at_middle(fits, found, inner, w) - _at_middle(fits, found, outer, w), -MOST_JUMP, MOST_JUMP)
    normal, place = fits.normals.reshape(-1, 3), positions.reshape(-1, 3)
    turn = normal[inner] - normal[outer]
    chord = np.sqrt((turn * turn).sum(axis=1))
    convex = (turn * (place[inner] - place[outer])).sum(axis=1) > 0
    gap = np.linalg.norm(place[found.inner] - place[found.outer], axis=1)
    high = np.maximum(height.ravel()[found.inner], height.ravel()[found.outer])
    outline = np.maximum(patches.sides[:, 0], 1.0)
    swap = patches.pixels[found.first] > patches.pixels[found.second]  # the smaller one counts as first
    sign = np.where(swap, -1.0, 1.0)

    def quantiles(values: NDArray, shares: tuple[float, ...] = QUANTILES) -> list[FloatArray]:
        ordered = values[np.lexsort((values, pair))]
        return [ordered[found.start[:-1] + (share * (sizes - 1)).astype(np.int64)] for share in shares]

    def mean(values: NDArray) -> FloatArray:
        return np.bincount(pair, values, minlength=count) / sizes

    in_front = [np.bincount(pair[which], minlength=count) for which in (jump > IN_FRONT, jump < -IN_FRONT)]
    smaller, larger = np.where(swap, in_front[::-1], in_front) / sizes
    outline_s = np.where(swap, outline[found.second], outline[found.first])
    outline_l = np.where(swap, outline[found.first], outline[found.second])
    length = mean(np.sqrt((place[found.inner] ** 2).sum(axis=1))) * sizes
    unknown = np.full(len(found.inner), np.nan)
    up_inner, up_outer = (unknown, unknown) if up is None else (_along(normal[inner], up), _along(normal[outer], up))
    rows = [
        *quantiles(jump * sign[pair]),
        *quantiles(np.where(convex, chord, -chord)),
        *quantiles(np.abs(jump)),
        *quantiles(gap, (0.1, 0.5)),
        *quantiles(high, (0.1, 0.9)),
        mean(np.abs(jump) < IN_FRONT),
        smaller,
        larger,
        mean(found.steps),
        mean(found.steps == 1),
        mean(found.along_row),
        length,
        sizes / outline_s,
        sizes / outline_l,
        mean((up_inner + up_outer) / 2),
        sign * mean(up_inner - up_outer),
    ]
    return np.stack(rows, axis=1).astype(np.float32) if count else _none(AT_BORDER), np.stack(in_front)


def shape_features(
    first: IntArray,
    second: IntArray,
    hidden: NDArray[np.bool_],
    at_hole: NDArray[np.bool_],
    patches: PatchSums,
    up: FloatArray | None,
) -> Float32Array:
    """(P, len(OF_BOTH)) of pairs (P,) of patches, whether they adjoin or not."""
    if kernels.compiled is None:
        return shape_features_reference(first, second, hidden, at_hole, patches, up)
    features = np.empty((len(first), len(OF_BOTH)), dtype=np.float32)
    sums = (patches.sums, patches.bins, patches.sides, patches.with_table)
    kernels.compiled.describe_pairs(*sums, first, second, hidden, at_hole, up, features)
    return features


def shape_features_reference(
    first: IntArray,
    second: IntArray,
    hidden: NDArray[np.bool_],
    at_hole: NDArray[np.bool_],
    patches: PatchSums,
    up: FloatArray | None,
) -> Float32Array:
    """`shape_features` in NumPy."""
    if not len(first):
        return _none(OF_BOTH)
    measures = measures_of(patches)
    pixels = measures.pixels
    swap = pixels[first] > pixels[second]
    s, l = np.where(swap, second, first), np.where(swap, first, second)  # noqa: E741
    both = pixels[s] + pixels[l]
    rows: list[NDArray] = [hidden, at_hole]
    for terms in (3, 6):
        error, factors = fit_quadratics(measures.moments, measures.products, measures.squares, pixels, terms)
        united, _ = fit_quadratics(
            measures.moments[s] + measures.moments[l],
            measures.products[s] + measures.products[l],
            measures.squares[s] + measures.squares[l],
            both,
            terms,
        )
        apart = np.sqrt((error[s] * error[s] * pixels[s] + error[l] * error[l] * pixels[l]) / both)
        # The larger one's surface where the smaller one is.
        moments, products, at = measures.moments[s][:, :terms, :terms], measures.products[s][:, :terms], factors[l]
        along = np.stack([in_order(moments[:, i] * at) for i in range(terms)], axis=1)
        square = measures.squares[s] - 2 * in_order(at * products) + in_order(at * along)
        off = np.minimum(np.sqrt(np.maximum(square, 0) / pixels[s]), 1.0)
        off_mean = np.clip((products[:, 0] - in_order(at * moments[:, 0])) / pixels[s], -1, 1)
        rows += [error[s], error[l], united, united - apart, off, off_mean]
    length = np.linalg.norm(measures.normal, axis=1)
    normal = measures.normal / np.maximum(length, 1e-9)[:, None]
    unknown = np.full(len(first), np.nan)
    rows += [np.linalg.norm(normal[s] - normal[l], axis=1), 1 - length[s], 1 - length[l]]
    rows += [unknown, unknown] if up is None else [_along(normal[s], up), _along(normal[l], up)]
    low, middle, high = measures.heights.T
    rows += [low[s], low[l], middle[s], middle[l], high[s], high[l]]
    rows += [high[s] - high[l], low[s] - low[l], low[s] - high[l], low[l] - high[s]]
    for values in (*measures.sides.T, measures.edge, measures.area):
        rows += [values[s], values[l]]
    between = measures.centre[s] - measures.centre[l]
    distance = np.maximum(np.linalg.norm(between, axis=1), 1e-6)
    rows += [pixels[s] / pixels[l], pixels[s], distance]
    if up is None:
        rows += [unknown, unknown]
    else:
        rise = _along(between, up)
        rows += [rise / distance, np.sqrt(np.maximum(distance * distance - rise * rise, 0))]
    own = extents(measures.scatter)
    share = (pixels[s] * pixels[l] / (both * both))[:, None, None]
    scatter = (
        measures.scatter[s] * (pixels[s] / both)[:, None, None]
        + measures.scatter[l] * (pixels[l] / both)[:, None, None]
        + share * between[:, :, None] * between[:, None, :]
    )
    united_extents = extents(scatter)
    for axis in range(3):
        rows += [own[s, axis], own[l, axis], united_extents[:, axis]]
    rows += [(normal[s] * between).sum(axis=1) / distance, -(normal[l] * between).sum(axis=1) / distance]
    return np.stack(rows, axis=1).astype(np.float32)


def stand_apart(features: Float32Array) -> NDArray[np.bool_]:
    """(P,) which pairs that adjoin, by their features (P, len(NAMES)), stand on the table one behind the other.

    Trees that know pots take two cans of one height for the near and the far wall of one; but a pot's far wall does not
    stand on the table where one sees it.
    """
    of = dict(zip(NAMES, features.T, strict=True))
    upright = np.minimum(of["height_95_s"], of["height_95_l"]) > UPRIGHT
    upright &= of["pixels"] > SHOWN
    stand = np.minimum(of["stands_s"], of["stands_l"]) > STANDS
    behind = (of["gap_10"] > BEHIND) & (of["level"] < ON_ONE_LEVEL) & (of["share_of_smaller"] > ADJOINING)
    return np.asarray(upright & stand & behind)


def _along(vectors: NDArray, direction: FloatArray) -> FloatArray:
    """(V,) how far vectors (V, 3) go along a direction (3,), added up as C does."""
    return np.asarray(vectors[:, 0] * direction[0] + vectors[:, 1] * direction[1] + vectors[:, 2] * direction[2])


def _none(names: list[str]) -> Float32Array:
    return np.empty((0, len(names)), dtype=np.float32)


def _inward(
    flat: NDArray[np.int32], at: IntArray, step: IntArray, along_row: NDArray[np.bool_], h: int, w: int
) -> IntArray:
    """The pixels (B,) some steps inside of their patch from the border, or themselves where it is narrower."""
    ahead = np.where(along_row, at % w, at // w) + INNER * np.sign(step)
    inside = (ahead >= 0) & (ahead < np.where(along_row, w, h))
    there = np.where(inside, at + INNER * step, at)
    return np.where(flat[there] == flat[at], there, at)


def _at_middle(fits: SurfaceFits, found: Borders, pixel: IntArray, w: int) -> FloatArray:
    """(B,) the inverse depth that a pixel's plane has in the middle between the border's two pixels."""
    row = (found.inner // w + found.outer // w) / 2 - pixel // w
    column = (found.inner % w + found.outer % w) / 2 - pixel % w
    slope = fits.slopes.reshape(-1, 2)[pixel]
    return np.asarray(fits.inverse_depth.ravel()[pixel] + slope[:, 0] * column + slope[:, 1] * row)
