"""What is measured on each patch by itself: sums over its pixels, from which any union of patches is measured, too."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from grasping.segmentation import kernels
from grasping.segmentation.surface_fits import SurfaceFits
from grasping.segmentation.working_image import WorkingImage

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
Float32Array = NDArray[np.float32]
Labels = NDArray[np.int32]

QUADRATIC = ((0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2))  # powers of column and row in the fitted surface
POWERS = tuple((i, j) for i in range(5) for j in range(5 - i))  # of its normal equations
TALLEST, BINS = 0.512, 256  # m and number: heights are counted in bins of 2 mm
LOW = 0.012  # m: a patch's pixel at the table's side as low as this stands on it
SUMS = 1 + len(POWERS) + len(QUADRATIC) + 1 + 3 + 6 + 3 + 1 + 1 + 2  # see `sums_reference`
SIDES = 5
SWEEPS = 8  # over all of a matrix, after which it is diagonal
LITTLE = 1e-9  # of a ridge in fits of few pixels
FAR_OUT, LITTLE_OUT = 20.0, 2.0  # times the table's noise: more does not count, less may be the table


@dataclass(frozen=True)
class PatchSums:
    """What is added up over the pixels of patches 0 … n (row 0 is empty), as in `sums_reference`: sums (n + 1, SUMS),
    bins (n + 1, BINS), sides (n + 1, SIDES). with_table: whether a table was found.
    """

    sums: FloatArray
    bins: FloatArray
    sides: FloatArray
    with_table: bool

    @property
    def pixels(self) -> FloatArray:
        """(n + 1,) of each patch."""
        return self.sums[:, 0]

    def of_groups(self, group: IntArray, first: IntArray, second: IntArray, adjoining: IntArray) -> PatchSums:
        """Of groups 0 … G: group (n + 1,) of each patch. adjoining: (P,) the sides that pairs of patches share."""
        count = int(group.max()) + 1
        sums, bins, sides = (np.zeros((count, rows.shape[1])) for rows in (self.sums, self.bins, self.sides))
        for added, rows in ((sums, self.sums), (bins, self.bins), (sides, self.sides)):
            for number, row in zip(group.tolist(), rows, strict=True):  # in this order
                added[number] += row
        inside = group[first] == group[second]  # what divided two patches of a group is no outline of it
        sides[:, 0] -= 2 * np.bincount(group[first[inside]], adjoining[inside], minlength=count)
        return PatchSums(sums, bins, sides, self.with_table)


@dataclass(frozen=True)
class PatchMeasures:
    """Of patches 0 … n (row 0 is empty): pixels (n + 1,); moments (n + 1, 6, 6), products (n + 1, 6) and squares
    (n + 1,) of the fit of inverse depth by a quadratic of column and row (rad from the image's middle); centre
    (n + 1, 3), m from the camera, and scatter (n + 1, 3, 3); normal (n + 1, 3), their mean; area (n + 1,), m² across
    the line of sight; edge (n + 1,), the mean; heights (n + 1, 3), m, of which 5, 50 and 95 % are lower;
    outline (n + 1,), sides of pixels, and of these the share beside the table, low beside the table, where nothing is
    measured, and at the image's edge, sides (n + 1, 4); over (n + 1, 2), the mean of how many times the table's noise
    pixels are nearer than it, and the share of those that hardly are.
    """

    pixels: FloatArray
    moments: FloatArray
    products: FloatArray
    squares: FloatArray
    centre: FloatArray
    scatter: FloatArray
    normal: FloatArray
    area: FloatArray
    edge: FloatArray
    heights: FloatArray
    outline: FloatArray
    sides: FloatArray
    over: FloatArray


def add_up_patches(
    image: WorkingImage,
    fits: SurfaceFits,
    positions: Float32Array,
    labels: Labels,
    count: int,
    edge: Float32Array,
    height: Float32Array,
    table: NDArray[np.bool_],
    above: Float32Array,
    noise: float,
) -> PatchSums:
    """positions (h, w, 3), m; edge, height (h, w), m above the table, NaN without one; table (h, w): its pixels; above
    (h, w), 1/m by which a pixel is nearer than the table, whose noise is so much, NaN without one.
    """
    arguments = (image.inverse_depth, fits.normals, positions, labels, edge, height, table, above)
    rows = [np.zeros((count + 1, width)) for width in (SUMS, BINS, SIDES)]
    add_up = sums_reference if kernels.compiled is None else kernels.compiled.measure_patches
    add_up(*arguments, image.pixel, max(noise, 1e-9), *rows)
    return PatchSums(rows[0], rows[1], rows[2], noise == noise)


def measures_of(patches: PatchSums) -> PatchMeasures:
    """What the sums say of each patch."""
    sums, sides, with_table = patches.sums, patches.sides, patches.with_table
    count = len(sums) - 1
    pixels = sums[:, 0]
    at_least = np.maximum(pixels, 1.0)
    number = {power: 1 + k for k, power in enumerate(POWERS)}
    moments = np.empty((count + 1, 6, 6))
    for i, (a, b) in enumerate(QUADRATIC):
        for j, (c, d) in enumerate(QUADRATIC):
            moments[:, i, j] = sums[:, number[a + c, b + d]]
    at = 1 + len(POWERS)
    products, squares = sums[:, at : at + 6], sums[:, at + 6]
    at += 7
    centre, second = sums[:, at : at + 3] / at_least[:, None], sums[:, at + 3 : at + 9] / at_least[:, None]
    scatter = np.empty((count + 1, 3, 3))
    for k, (i, j) in enumerate(((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))):
        scatter[:, i, j] = scatter[:, j, i] = second[:, k] - centre[:, i] * centre[:, j]
    at += 9
    outline = np.maximum(sides[:, 0], 1.0)
    return PatchMeasures(
        pixels=pixels,
        moments=moments,
        products=products,
        squares=squares,
        centre=centre,
        scatter=scatter,
        normal=sums[:, at : at + 3] / at_least[:, None],
        area=sums[:, at + 3],
        edge=sums[:, at + 4] / at_least,
        heights=_quantiles(patches.bins) if with_table else np.full((count + 1, 3), np.nan),
        outline=outline,
        sides=sides[:, 1:] / outline[:, None],
        over=sums[:, at + 5 : at + 7] / at_least[:, None] if with_table else np.full((count + 1, 2), np.nan),
    )


def sums_reference(
    inverse_depth: Float32Array,
    normals: Float32Array,
    positions: Float32Array,
    labels: Labels,
    edge: Float32Array,
    height: Float32Array,
    table: NDArray[np.bool_],
    above: Float32Array,
    pixel: float,
    noise: float,
    sums: FloatArray,
    bins: FloatArray,
    sides: FloatArray,
) -> None:
    """Add up for each label: 1; column and row to `POWERS`; the quadratic's terms times inverse depth; its square;
    position; its products; normal; area; edge; times the noise over the table, and whether that is little. bins:
    heights. sides: of the outline, and what they are beside.
    """
    h, w = labels.shape
    at = np.flatnonzero(labels)
    own = labels.ravel()[at]
    row, column = np.divmod(at, w)
    across = (column - (w - 1) / 2) * pixel
    down = (row - (h - 1) / 2) * pixel
    q = inverse_depth.ravel()[at].astype(np.float64)
    place = positions.reshape(-1, 3)[at].astype(np.float64)
    normal = normals.reshape(-1, 3)[at].astype(np.float64)
    power_c, power_r = [np.ones(len(at))], [np.ones(len(at))]
    for _ in range(4):
        power_c.append(power_c[-1] * across)
        power_r.append(power_r[-1] * down)
    values = [power_c[0]]
    values += [power_c[i] * power_r[j] for i, j in POWERS]
    values += [power_c[i] * power_r[j] * q for i, j in QUADRATIC]
    values += [q * q]
    values += [place[:, k] for k in range(3)]
    values += [place[:, i] * place[:, j] for i, j in ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))]
    values += [normal[:, k] for k in range(3)]
    values += [pixel * pixel / (q * q), np.minimum(edge.ravel()[at].astype(np.float64), 2.0)]
    over = above.ravel()[at] / np.float32(noise)
    values += [np.minimum(over, np.float32(FAR_OUT)), over < np.float32(LITTLE_OUT)]
    for k, value in enumerate(values):
        sums[:, k] = np.bincount(own, value, minlength=len(sums))
    high = height.ravel()[at]
    known = np.isfinite(high)
    number = np.clip(high[known] * np.float32(BINS / TALLEST), 0, BINS - 1).astype(np.int64)
    bins += np.bincount(own[known] * BINS + number, minlength=bins.size).reshape(bins.shape)
    on_table, measured = table.ravel(), inverse_depth.ravel() > 0
    for step, inside in ((1, column < w - 1), (-1, column > 0), (w, row < h - 1), (-w, row > 0)):
        beside = np.where(inside, at + step, 0)
        outside = ~inside | (labels.ravel()[beside] != own)
        bare = outside & inside & (labels.ravel()[beside] == 0)
        foot = bare & on_table[beside]
        hole = bare & ~on_table[beside] & ~measured[beside]
        for k, which in enumerate((outside, foot, foot & (high < LOW), hole, ~inside)):
            sides[:, k] += np.bincount(own[which], minlength=len(sides))


def _quantiles(bins: FloatArray) -> FloatArray:
    """(n, 3) the heights, m, below which 5, 50 and 95 % of each row's pixels lie."""
    upto = np.cumsum(bins, axis=1)
    total = upto[:, -1:]
    width = TALLEST / BINS
    return np.stack([(np.count_nonzero(upto < share * total, axis=1) + 0.5) * width for share in (0.05, 0.5, 0.95)], 1)


def fit_quadratics(
    moments: FloatArray, products: FloatArray, squares: FloatArray, pixels: FloatArray, terms: int
) -> tuple[FloatArray, FloatArray]:
    """(P,) root mean square error, 1/m, and (P, terms) factors of the least-squares surface."""
    scale = np.sqrt(np.maximum(np.einsum("pii->pi", moments[:, :terms, :terms]), 1e-30))
    a = moments[:, :terms, :terms] / (scale[:, :, None] * scale[:, None, :]) + LITTLE * np.eye(terms)
    b = products[:, :terms] / scale
    for k in range(terms):  # by elimination: the matrix is symmetric and definite, whose pivots need not be looked for
        for i in range(k + 1, terms):
            share = a[:, k, i] / a[:, k, k]
            a[:, i, i:] -= share[:, None] * a[:, k, i:]
            b[:, i] -= share * b[:, k]
    for i in reversed(range(terms)):
        for j in range(i + 1, terms):
            b[:, i] -= a[:, i, j] * b[:, j]
        b[:, i] /= a[:, i, i]
    factors = b / scale
    left = squares - in_order(factors * products[:, :terms])
    return np.sqrt(np.maximum(left, 0) / np.maximum(pixels, 1)), factors


def in_order(rows: FloatArray) -> FloatArray:
    """(P,) the sums along rows (P, K), added up one after the other as C does."""
    return np.asarray(sum(rows.T))


def extents(scatter: FloatArray) -> FloatArray:
    """(P, 3) standard deviations along the principal axes, m, rising, of (P, 3, 3); by Jacobi's rotations."""
    a = np.triu(scatter) + np.triu(scatter, 1).swapaxes(1, 2)  # the upper half counts
    for p, q, r in ((0, 1, 2), (0, 2, 1), (1, 2, 0)) * SWEEPS:
        turned = a[:, p, q] != 0
        if not turned.any():
            continue
        with np.errstate(over="ignore"):
            theta = (a[:, q, q] - a[:, p, p]) / (2.0 * np.where(turned, a[:, p, q], 1.0))
            size = 1.0 / (np.abs(theta) + np.sqrt(theta * theta + 1.0))
        t = np.where(turned, np.where(theta < 0, -size, size), 0.0)
        c = 1.0 / np.sqrt(t * t + 1.0)
        s, step = t * c, t * a[:, p, q]
        rp, rq = a[:, r, p].copy(), a[:, r, q].copy()
        a[:, p, p] -= step
        a[:, q, q] += step
        a[:, p, q] = a[:, q, p] = 0.0
        a[:, r, p] = a[:, p, r] = c * rp - s * rq
        a[:, r, q] = a[:, q, r] = s * rp + c * rq
    return np.sqrt(np.maximum(np.sort(np.einsum("pii->pi", a), axis=1), 0))
