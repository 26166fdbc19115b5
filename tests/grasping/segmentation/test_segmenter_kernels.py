"""The segmenter's compiled pixel loops against their NumPy references: the same to the last bit, on any image."""

from __future__ import annotations

import subprocess
import sys
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import ndimage

from grasping.segmentation import kernels
from grasping.segmentation.boosted_trees import BoostedTrees
from grasping.segmentation.correlation_clustering import cluster_reference
from grasping.segmentation.flying_pixels import single_pixels, single_pixels_reference
from grasping.segmentation.frame import distances, distances_reference
from grasping.segmentation.group_features import OF_SHAPE, shapes_of_groups, shapes_of_groups_reference
from grasping.segmentation.pair_features import (
    AT_BORDER,
    OF_BOTH,
    border_features,
    border_features_reference,
    shape_features,
    shape_features_reference,
)
from grasping.segmentation.patch_measures import BINS, SIDES, SUMS, PatchSums, sums_reference
from grasping.segmentation.patch_pairs import borders, steps_to_borders, steps_to_borders_reference
from grasping.segmentation.pieces import label_pieces
from grasping.segmentation.planes import (
    LEVEL,
    NEARBY,
    draw_plane_reference,
    heights_above,
    heights_above_reference,
    refine,
    refine_reference,
)
from grasping.segmentation.surface_fits import SurfaceFits, fit_surfaces_reference
from grasping.segmentation.surface_patches import edges_reference, grow_patches_reference, merge_patches_reference
from grasping.segmentation.table_relief import (
    Relief,
    heights_over,
    mean_of_nine,
    mean_of_nine_reference,
    rise_over_table,
    stand_out,
    stand_out_reference,
)
from grasping.segmentation.working_image import (
    WorkingImage,
    inverse_depths,
    inverse_depths_reference,
    positions,
    positions_reference,
    reduce_blocks_reference,
)
from grasping.segmentation.wrinkles import wrinkles, wrinkles_reference

compiled: Any = kernels.compiled
pytestmark = pytest.mark.skipif(compiled is None, reason="this installation has no compiled kernels")
seeds = st.integers(0, 2**32 - 1).map(np.random.default_rng)
shapes = st.one_of(
    st.tuples(st.integers(1, 40), st.integers(1, 60)), st.sampled_from([(1, 1), (1, 50), (50, 1), (3, 3), (45, 70)])
)
TO_FRAME = np.linalg.inv(np.array([[0.002, 0, -0.08], [0, 0.002, -0.05], [0, 0, 1]])).astype(np.float32)


def same(one: Any, other: Any) -> None:
    """Equal to the last bit, but for what kind of NaN it is and the sign of 0."""
    np.testing.assert_array_equal(one, other)
    assert one.dtype == other.dtype


def blank(shape: tuple[int, ...], *axis: int) -> Any:
    return np.zeros((*shape, *axis), dtype=np.float32)


def scene(random: np.random.Generator, shape: tuple[int, int]) -> Any:
    """Inverse depth (h, w) of slanted pieces before a wall, with noise and holes."""
    h, w = shape
    row, column = np.mgrid[:h, :w]
    q = np.full(shape, 0.8)
    for _ in range(random.integers(0, 8)):
        top, left = random.integers(0, h), random.integers(0, w)
        part = np.s_[top : top + random.integers(1, h + 1), left : left + random.integers(1, w + 1)]
        slope = random.normal(0, 0.01, 2)
        q[part] = (random.uniform(1, 2) + slope[0] * (row - top) + slope[1] * (column - left))[part]
    q += random.normal(0, random.choice([0, 0.001, 0.01]), shape)
    q[random.random(shape) < random.choice([0, 0.02, 0.5])] = 0
    return q.astype(np.float32)


def pixels(random: np.random.Generator, shape: tuple[int, int]) -> Any:
    """Some that are asked for: none, all, single ones, or whole regions."""
    share = random.choice([0, 0.05, 0.5, 1])
    chosen = random.random(shape) < share
    if random.random() < 0.5 and min(shape) > 4:
        chosen |= np.kron(random.random((-(-shape[0] // 4), -(-shape[1] // 4))) < 0.4, np.ones((4, 4), bool))[
            : shape[0], : shape[1]
        ]
    return np.flatnonzero(chosen)


def fits_of(q: Any, asked: Any) -> SurfaceFits:
    fits = SurfaceFits(blank(q.shape), blank(q.shape, 2), blank(q.shape, 3))
    compiled.fit_surfaces(q, asked, TO_FRAME, fits.inverse_depth, fits.slopes, fits.normals)
    return fits


def positions_of(q: Any) -> Any:
    row, column = np.mgrid[: q.shape[0], : q.shape[1]]
    depth = 1 / np.maximum(q, 0.1)
    return np.stack([(column * 0.002 - 0.08) * depth, (row * 0.002 - 0.05) * depth, depth], axis=-1).astype(np.float32)


def edges_of(fits: SurfaceFits, places: Any, asked: Any) -> Any:
    edge = np.full(fits.inverse_depth.shape, np.inf, dtype=np.float32)
    compiled.edges(fits.inverse_depth, fits.slopes, fits.normals, places, asked, edge)
    return edge


def random_edges(random: np.random.Generator, shape: tuple[int, int]) -> Any:
    """As smooth as edges are, or as rough as none are; many equal."""
    edge = random.gamma(1, 0.3, shape)
    if random.random() < 0.5:
        edge = np.round(edge * 4) / 4
    edge[random.random(shape) < random.choice([0, 0.1, 0.6])] = np.inf
    return edge.astype(np.float32)


@settings(deadline=None, max_examples=30)
@given(seeds, shapes, st.sampled_from([np.float32, np.float64]))
def test_points_and_inverse_depths_are_alike(random: np.random.Generator, shape: tuple[int, int], dtype: Any) -> None:
    q = scene(random, shape)
    along, down = blank((shape[1],), 3), blank((shape[0],), 3)
    along[:], down[:] = random.normal(size=along.shape), random.normal(size=down.shape)
    same(positions(q, along, down), positions_reference(q, along, down))
    points = random.normal(0, 1, (q.size, 3)).astype(dtype)
    points[random.random(q.size) < 0.1] = random.choice([np.nan, np.inf, 0])
    arguments = (points, random.random(q.size) < 0.9, random.normal(size=3), random.normal(0, 0.1))
    same(inverse_depths(*arguments), inverse_depths_reference(*arguments))
    plane = random.normal(size=4)
    same(heights_above(*arguments[:2], plane), heights_above_reference(*arguments[:2], plane))
    for one, other in zip(distances(points, 0.5, 1.5), distances_reference(points, 0.5, 1.5), strict=True):
        same(one, other)
    close, chosen = points * dtype(0.02), pixels(random, shape)
    same(single_pixels(close, chosen, shape), single_pixels_reference(close, chosen, shape))


@settings(deadline=None, max_examples=30)
@given(seeds, shapes)
def test_means_and_pieces_are_alike(random: np.random.Generator, shape: tuple[int, int]) -> None:
    values, mask = scene(random, shape), random.random(shape) < random.choice([0, 0.3, 0.6, 1])
    q, most = np.where(mask, values, np.float32(0)), random.choice([0.02, 1.0, 5.0])
    same(mean_of_nine(values, q, most), mean_of_nine_reference(values, q, most))
    labels, count = label_pieces(mask)
    expected, number = ndimage.label(mask)
    assert count == number
    same(labels, expected)


@settings(deadline=None, max_examples=30)
@given(seeds, st.integers(3, 60), st.booleans())
def test_planes_are_drawn_and_refined_alike(random: np.random.Generator, count: int, level: bool) -> None:
    points = random.normal(0, 1, (count, 3)) * [1, 1, random.choice([0, 0.01, 1])]
    if random.random() < 0.3:
        points = np.round(points)  # many alike, and many on one line
    corners, drawn = random.integers(0, count, (LEVEL + 20, 3)), random.integers(0, count, (20, NEARBY))
    tested, up = random.integers(0, count, 50), np.array([0.0, 0.0, 1.0]) if level else None
    plane = np.empty(4)
    found = compiled.draw_plane(points, corners, drawn, tested, up, LEVEL, np.cos(np.radians(20)), 0.05, plane)
    expected = draw_plane_reference(points, corners, drawn, tested, up, 0.05)
    assert found == (expected is not None)
    equation = np.array([0.0, 0.6, 0.8, random.normal()])
    if expected is not None:
        same(plane, expected)
        equation = plane
    one, other = (way(points, equation, 0.1, (0.003, 0.2)) for way in (refine, refine_reference))
    same(one.equation, other.equation)
    assert (one.band, one.residual) == (other.band, other.residual)


def image_of(q: Any) -> WorkingImage:
    rays = np.array([[0.002, 0, -0.08], [0, 0.002, -0.05], [0, 0, 1]])
    return WorkingImage(q, rays, np.zeros(3), 0.002, np.arange(q.size, dtype=np.int32), q.ravel())


@settings(deadline=None, max_examples=30)
@given(seeds, shapes)
def test_what_stands_out_of_a_table_is_alike(random: np.random.Generator, shape: tuple[int, int]) -> None:
    q = scene(random, shape)
    image, plane = image_of(q), np.array([0.1, 0.0, -1.0, random.uniform(1, 1.3)])
    bend = random.normal(0, 0.001, shape).astype(np.float32)
    noise, mean_noise = random.uniform(0.001, 0.01, 2)
    level, height = heights_over(image, plane)
    table, above = rise_over_table(q, level, bend)
    mean = mean_of_nine(above, q, 0.05)
    found = stand_out(q, above, mean, height, noise, mean_noise)
    same(found, stand_out_reference(q, above, mean, height, noise, mean_noise))
    labels, count = label_pieces(found | (random.random(shape) < 0.1))
    above = np.where(random.random(shape) < 0.5, above, above * np.float32(0.1))
    what = (labels, count, Relief(above, table, noise, found), q, 0.8)
    same(wrinkles(*what), wrinkles_reference(*what))
    kernels.compiled = None
    try:
        expected = (*heights_over(image, plane), *rise_over_table(q, level, bend))
    finally:
        kernels.compiled = compiled
    for one, other in zip((level, height, *rise_over_table(q, level, bend)), expected, strict=True):
        same(one, other)


def sums_of(random: np.random.Generator, q: Any, labels: Any, count: int, with_table: bool) -> PatchSums:
    rows = [np.zeros((count + 1, width)) for width in (SUMS, BINS, SIDES)]
    normals = random.normal(size=(*q.shape, 3)).astype(np.float32) * np.float32(0.5)
    height = random.normal(0.1, 0.1, q.shape).astype(np.float32)
    edge, table = random_edges(random, q.shape), random.random(q.shape) < 0.3
    above, noise = random.normal(0, 0.02, q.shape).astype(np.float32), 0.002 if with_table else np.nan
    compiled.measure_patches(q, normals, positions_of(q), labels, edge, height, table, above, 0.002, noise, *rows)
    return PatchSums(rows[0], rows[1], rows[2], with_table)


@settings(deadline=None, max_examples=40)
@given(seeds, shapes, st.booleans())
def test_patches_and_pairs_of_them_are_described_alike(
    random: np.random.Generator, shape: tuple[int, int], with_table: bool
) -> None:
    q = scene(random, shape)
    labels, count = label_pieces((q > 0) & (random.random(shape) < random.choice([0.3, 0.6, 0.9])))
    up = np.array([0.0, -0.6, -0.8]) if with_table else None
    patches = sums_of(random, q, labels, count, with_table)
    same(shapes_of_groups(patches, up), shapes_of_groups_reference(patches, up))
    pairs = np.argwhere(np.triu(random.random((count, count)) < 4 / max(count, 1), 1)).T + 1
    first, second = np.ascontiguousarray(pairs)
    flags = [random.random(len(first)) < 0.5 for _ in range(2)]
    same(
        shape_features(first, second, flags[0], flags[1], patches, up),
        shape_features_reference(first, second, flags[0], flags[1], patches, up),
    )
    asked = np.flatnonzero(labels)
    found = borders(labels, count, (labels == 0) & (random.random(shape) < 0.8))
    height = random.normal(0.1, 0.1, shape).astype(np.float32) if with_table else np.full_like(q, np.nan)
    what = (found, fits_of(q, asked), positions_of(q), labels, height, up, patches)
    for one, other in zip(border_features(*what), border_features_reference(*what), strict=True):
        same(one, other)


@settings(deadline=None, max_examples=30)
@given(seeds, shapes)
def test_borders_are_alike(random: np.random.Generator, shape: tuple[int, int]) -> None:
    labels = random.integers(0, 5, shape).astype(np.int32) * (random.random(shape) < random.uniform(0, 1))
    unknown = random.random(shape) < 0.8
    same(steps_to_borders(labels, unknown), steps_to_borders_reference(labels, unknown))


@settings(deadline=None, max_examples=30)
@given(seeds, shapes, st.integers(1, 5))
def test_blocks_are_reduced_alike(random: np.random.Generator, shape: tuple[int, int], block: int) -> None:
    q = scene(random, (shape[0] + block, shape[1] + block))
    reduced = blank((q.shape[0] // block, q.shape[1] // block))
    compiled.reduce_blocks(q, block, reduced)
    same(reduced, reduce_blocks_reference(q, block))


@settings(deadline=None, max_examples=50)
@given(seeds, shapes)
def test_surfaces_and_edges_are_alike(random: np.random.Generator, shape: tuple[int, int]) -> None:
    q = scene(random, shape)
    asked = pixels(random, shape)
    fits, reference = fits_of(q, asked), fit_surfaces_reference(q, asked, TO_FRAME)
    same(fits.inverse_depth, reference.inverse_depth)
    same(fits.slopes, reference.slopes)
    same(fits.normals, reference.normals)
    places = positions_of(q)
    expected = np.full(q.size, np.inf, dtype=np.float32)
    expected[asked] = edges_reference(fits.inverse_depth, fits.slopes, fits.normals, places, asked)
    same(edges_of(fits, places, asked).ravel(), expected)


@settings(deadline=None, max_examples=50)
@given(seeds, shapes)
def test_patches_grow_and_merge_alike(random: np.random.Generator, shape: tuple[int, int]) -> None:
    if random.random() < 0.5:
        q = scene(random, shape)
        asked = pixels(random, shape)
        fits = fits_of(q, asked)
        edge, fitted = edges_of(fits, positions_of(q), asked), fits.inverse_depth
    else:
        edge = random_edges(random, shape)
        fitted = (1 + random.normal(0, random.choice([0, 0.02]), shape)).astype(np.float32)
    labels = np.zeros(shape, dtype=np.int32)
    count = compiled.grow_patches(edge, fitted, labels)
    expected, number = grow_patches_reference(edge, fitted)
    assert count == number
    same(labels, expected)
    expected, number = merge_patches_reference(edge, labels, count)
    assert compiled.merge_patches(edge, labels, count) == number
    same(labels, expected)


@settings(deadline=None, max_examples=40)
@given(seeds, shapes)
def test_scattered_labels_merge_alike(random: np.random.Generator, shape: tuple[int, int]) -> None:
    count = int(random.integers(0, min(30, shape[0] * shape[1]) + 1))
    labels = random.integers(0, count + 1, shape).astype(np.int32)
    edge = random_edges(random, shape)
    expected, number = merge_patches_reference(edge, labels, count)
    assert compiled.merge_patches(edge, labels, count) == number
    same(labels, expected)


@settings(deadline=None, max_examples=40)
@given(seeds, shapes)
def test_patches_are_measured_alike(random: np.random.Generator, shape: tuple[int, int]) -> None:
    q = scene(random, shape)
    count = int(random.integers(0, 9))
    labels = random.integers(0, count + 1, shape).astype(np.int32) * (q > 0)
    height = random.normal(0.1, 0.3, shape)
    height[random.random(shape) < 0.2] = random.choice([np.nan, np.inf, 1e30, -1e30])
    arrays = [random.normal(size=(*shape, 3)), random.normal(size=(*shape, 3)), random_edges(random, shape), height]
    places, towards, edge, heights = (array.astype(np.float32) for array in arrays)
    above = random.normal(0, 0.02, shape).astype(np.float32)
    above[random.random(shape) < 0.05] = random.choice([np.nan, np.inf, -np.inf])
    table = random.random(shape) < 0.3
    arguments = (q, towards, places, labels, edge, heights, table, above, 0.002, random.choice([0.001, 1e-9, np.nan]))
    sums = [[np.zeros((count + 1, width)) for width in (SUMS, BINS, SIDES)] for _ in range(2)]
    compiled.measure_patches(*arguments, *sums[0])
    sums_reference(*arguments, *sums[1])
    for one, other in zip(*sums, strict=True):
        same(one, other)


def random_trees(random: np.random.Generator, features: int, trees: int, depth: int) -> BoostedTrees:
    rows: list[tuple[int, float, int, int, int, float]] = []

    def grow(level: int) -> int:
        at = len(rows)
        rows.append((-1, 0.0, 0, 0, 0, random.normal()))
        if level == 0 or (level < depth and random.random() < 0.8):
            ask = (int(random.integers(features)), float(random.integers(-2, 3)))
            rows[at] = (*ask, grow(level + 1), grow(level + 1), int(random.integers(2)), 0.0)
        return at

    start = [grow(0) for _ in range(trees)]
    feature, threshold, left, right, missing, value = zip(*rows, strict=True) if rows else [()] * 6
    whole = [np.array(column, dtype=np.int32) for column in (feature, left, right, missing, start)]
    return BoostedTrees(
        feature=whole[0],
        threshold=np.array(threshold, dtype=np.float32),
        left=whole[1],
        right=whole[2],
        missing_left=whole[3],
        value=np.array(value, dtype=np.float64),
        start=whole[4],
        baseline=0.3,
    )


@settings(deadline=None, max_examples=40)
@given(seeds, st.integers(0, 50), st.integers(1, 20), st.integers(1, 8))
def test_trees_of_few_leaves_and_many_answer_alike_also_where_a_feature_is_not_known(
    random: np.random.Generator, rows: int, trees: int, depth: int
) -> None:
    model = random_trees(random, 5, trees, depth)
    features = random.integers(-3, 4, (rows, 5)).astype(np.float32)
    features[random.random((rows, 5)) < 0.2] = random.choice([np.nan, np.inf, -np.inf])
    same(model.log_odds(features), model.log_odds_reference(features))


@settings(deadline=None, max_examples=50)
@given(seeds, st.integers(1, 40))
def test_nodes_are_clustered_alike(random: np.random.Generator, count: int) -> None:
    first, second = np.nonzero(np.triu(random.random((count, count)) < random.choice([0.1, 0.5, 1]), 1))
    agreement = random.normal(random.choice([-1, 0, 1]), 1, len(first))
    if random.random() < 0.5:
        agreement = np.round(agreement)
    order = random.permutation(len(first))
    pairs = (first[order], second[order], agreement[order])
    root = np.empty(count, dtype=np.int64)
    compiled.cluster(*pairs, root)
    same(root, cluster_reference(count, *pairs))


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, -1.0, 3e38])
def test_no_number_hangs_or_crashes_the_kernels(value: float) -> None:
    random = np.random.default_rng(0)
    q = scene(random, (30, 40))
    q[random.random(q.shape) < 0.2] = value
    asked = np.arange(q.size)
    reduced = blank((10, 13))
    compiled.reduce_blocks(q, 3, reduced)
    fits, places = fits_of(q, asked), positions_of(q)
    places[random.random(q.shape) < 0.1] = value
    mean_of_nine(q, q, 0.02)
    stand_out(q, q, q, q, value, value)
    edge = edges_of(fits, places, asked)
    edge[random.random(q.shape) < 0.1] = value
    labels = np.zeros(q.shape, dtype=np.int32)
    count = compiled.grow_patches(edge, fits.inverse_depth, labels)
    count = compiled.merge_patches(np.where(edge < 1, edge, np.float32(value)), labels, count)
    sums = [np.zeros((count + 1, width)) for width in (SUMS, BINS, SIDES)]
    compiled.measure_patches(q, fits.normals, places, labels, edge, q, q > 0, q, value, value, *sums)
    first, second = np.triu_indices(20, 1)
    agreement = random.normal(size=len(first))
    agreement[::3] = value
    compiled.cluster(first, second, agreement, np.empty(20, dtype=np.int64))


def calls() -> dict[str, list[Any]]:
    """Arguments with which each kernel works."""
    shape = (8, 10)
    asked = np.arange(10, 40)
    labels, edge = np.zeros(shape, dtype=np.int32), np.full(shape, 0.1, dtype=np.float32)
    one, three = blank(shape), blank(shape, 3)
    trees = random_trees(np.random.default_rng(1), 3, 2, 4)
    nodes = [trees.feature, trees.threshold, trees.left, trees.right, trees.missing_left, trees.value, trees.start]
    sums = [np.zeros((2, width)) for width in (SUMS, BINS, SIDES)]
    mask = np.ones(shape, dtype=bool)
    points, three_of, drawn = np.eye(9)[:, :3].copy(), np.arange(9).reshape(3, 3), np.zeros((2, NEARBY), dtype=np.int64)
    flags = [np.ones(1, dtype=bool), np.ones(1, dtype=bool)]
    surface = [one, blank(shape, 2), three, three.copy(), one.copy(), labels, np.ones(3)]
    pixel_pairs = [np.array([5, 6]), np.array([6, 7]), np.array([1, 1]), np.array([True, False]), np.array([1, 1])]
    of_pairs = [np.arange(3), np.array([0, 0]), np.array([1, 1]), np.array([1, 0]), sums[0], sums[2]]
    pairs = [*of_pairs, blank((2,), len(AT_BORDER)), np.zeros((2, 2), dtype=np.int64)]
    return {
        "positions": [one, blank((10,), 3), blank((8,), 3), three],
        "inverse_depths": [blank((20,), 3), np.ones(20, dtype=bool), 0.0, 0.0, 1.0, 0.0, blank((20,))],
        "single_pixels": [blank((80,), 3), asked, 10, np.zeros(30, dtype=bool)],
        "square_distances": [blank((20,), 3), 0.0, 4.0, blank((20,)), np.ones(20, dtype=bool)],
        "rise_over_plane": [blank((20,), 3), np.ones(20, dtype=bool), 0.0, 0.0, 1.0, 0.0, blank((20,))],
        "find_heights": [one, blank((10,)), blank((8,)), 0.5, one.copy(), one.copy()],
        "rise_over_table": [one, one.copy(), one.copy(), one.copy(), one.copy()],
        "mean_of_nine": [one, one.copy(), 0.02, one.copy()],
        "stand_out": [one, one.copy(), one.copy(), one.copy(), 0.1, 0.1, 0.1, 0.1, mask],
        "find_wrinkles": [labels, one, one.copy(), mask, 0.5, np.zeros(3, dtype=bool)],
        "draw_plane": [points, three_of, drawn, np.arange(9), points[1].copy(), 2, 0.9, 0.01, np.zeros(4)],
        "refine_plane": [points, 0.01, 0.001, 0.02, np.array([0.0, 0.0, 1.0, 0.0])],
        "describe_borders": [*surface, *pixel_pairs, *pairs],
        "describe_pairs": [*sums, True, np.array([0]), np.array([1]), *flags, np.ones(3), blank((1,), len(OF_BOTH))],
        "describe_groups": [*sums, True, np.ones(3), blank((2,), len(OF_SHAPE))],
        "label_pieces": [mask, labels],
        "steps_to_borders": [labels, mask, np.zeros((2, *shape), dtype=np.uint8)],
        "reduce_blocks": [one, 2, blank((4, 5))],
        "fit_surfaces": [one, asked, TO_FRAME, one.copy(), blank(shape, 2), three],
        "edges": [one, blank(shape, 2), three, three.copy(), asked, edge],
        "grow_patches": [edge, one, labels],
        "merge_patches": [edge, labels, 1],
        "measure_patches": [one, three, three, labels, edge, one, mask, one, 0.002, 0.001, *sums],
        "pack_trees": nodes,
        "add_trees": [compiled.pack_trees(*nodes), blank((4, 3)), np.zeros(4)],
        "cluster": [np.array([0, 1]), np.array([1, 2]), np.array([1.0, -1.0]), np.zeros(3, dtype=np.int64)],
    }


@pytest.mark.parametrize("name", calls())
def test_the_kernels_refuse_arrays_that_they_cannot_read(name: str) -> None:
    kernel, arguments = getattr(compiled, name), calls()[name]
    kernel(*arguments)
    for place, argument in enumerate(arguments):
        if not isinstance(argument, np.ndarray):
            continue
        size_is_free = (name, place) in {
            ("fit_surfaces", 1),
            ("edges", 4),
            ("pack_trees", 6),
            ("cluster", 3),
            ("find_wrinkles", 5),
            ("draw_plane", 0),
            ("draw_plane", 1),
            ("draw_plane", 2),
            ("draw_plane", 3),
            ("refine_plane", 0),
            ("single_pixels", 0),
        }
        if argument.shape == (3,) and name in ("draw_plane", "describe_borders", "describe_pairs", "describe_groups"):
            continue  # up, which may be None
        wrong: list[Any] = [argument.astype(np.complex64), np.zeros_like(argument, np.int16), None, 3, argument[None]]
        if not size_is_free:
            wrong += [np.concatenate([argument, argument])]
        if argument.ndim > 1:
            wrong += [np.asfortranarray(np.repeat(argument, 2, axis=-1))[..., ::2]]
        for other in wrong:
            with pytest.raises((TypeError, ValueError, BufferError)):
                kernel(*arguments[:place], other, *arguments[place + 1 :])
    with pytest.raises(TypeError):
        kernel(*arguments[:-1])


@pytest.mark.parametrize("index", [-1, 80, 2**62, -(2**63)])
def test_indices_out_of_range_are_refused(index: int) -> None:
    given = calls()
    bad = np.array([0, index, 1])
    for name, place in (("fit_surfaces", 1), ("edges", 4), ("draw_plane", 3)):
        with pytest.raises(ValueError, match="out of the array"):
            getattr(compiled, name)(*given[name][:place], bad, *given[name][place + 1 :])
    with pytest.raises(ValueError, match="out of the array"):
        compiled.cluster(np.array([0]), np.array([index]), np.array([1.0]), np.zeros(3, dtype=np.int64))
    for name, places in (
        ("single_pixels", (1,)),
        ("draw_plane", (1, 2)),
        ("describe_borders", (7, 8, 12, 13, 14)),
        ("describe_pairs", (4, 5)),
    ):
        for place in places:
            arguments = calls()[name]
            arguments[place].reshape(-1)[0] = index
            with pytest.raises(ValueError, match="out of the array"):
                getattr(compiled, name)(*arguments)
    label = np.int32(np.clip(index, -5, 2**31 - 1))
    arguments = calls()["find_wrinkles"]
    arguments[0][3, 3] = label
    with pytest.raises(ValueError, match="out of the array"):
        compiled.find_wrinkles(*arguments)
    edge, _, labels = given["grow_patches"]
    labels[3, 3] = label
    with pytest.raises(ValueError, match="out of the array"):
        compiled.merge_patches(edge, labels, 1)
    given["measure_patches"][3][3, 3] = label
    with pytest.raises(ValueError, match="out of the array"):
        compiled.measure_patches(*given["measure_patches"])
    for place in (0, 2, 3, 6):
        nodes = calls()["pack_trees"]
        nodes[place][:] = label if place or label > 0 else 9
        with pytest.raises(ValueError, match="out of the array"):
            compiled.add_trees(compiled.pack_trees(*nodes), blank((4, 3)), np.zeros(4))


def test_trees_that_lead_back_are_refused() -> None:
    arguments = calls()["pack_trees"]
    arguments[2][0] = 0
    with pytest.raises(ValueError, match="out of the array"):
        compiled.pack_trees(*arguments)


@pytest.mark.parametrize("other", [None, 3, np.zeros(4)])
def test_only_packed_trees_are_asked(other: Any) -> None:
    with pytest.raises(ValueError, match="PyCapsule"):
        compiled.add_trees(other, blank((4, 3)), np.zeros(4))


@pytest.mark.parametrize("arguments", [(0, (4, 5)), (9, (1, 1)), (-1, (4, 5)), (2, (4, 4))])
def test_blocks_that_do_not_fit_are_refused(arguments: tuple[int, tuple[int, int]]) -> None:
    block, shape = arguments
    with pytest.raises(ValueError, match=r"block|reduced"):
        compiled.reduce_blocks(blank((8, 10)), block, blank(shape))


def test_without_kernels_the_references_do_the_work() -> None:
    program = (
        "import sys; sys.modules['grasping.segmentation._kernels'] = None  # as where no compiler was found\n"
        "import grasping, grasping.segmentation.kernels as kernels\n"
        "assert kernels.compiled is None and not grasping.compiled"
    )
    subprocess.run([sys.executable, "-c", program], check=True)
