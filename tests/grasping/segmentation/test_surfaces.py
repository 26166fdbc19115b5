"""Patches of surface: what is fitted to them, where they end, and which may be of one object."""

import numpy as np
import pytest

from grasping.segmentation.frame import Frame
from grasping.segmentation.patch_measures import add_up_patches, measures_of
from grasping.segmentation.patch_pairs import Borders, borders
from grasping.segmentation.surface_fits import fit_surfaces
from grasping.segmentation.surfaces import Surfaces
from tests.grasping.rendered_scenes import look_down, render


def surfaces_of(boxes: list[tuple], noise: float = 0.0, tilt: float = 35.0) -> tuple[Surfaces, np.ndarray]:
    """The patches of boxes (x, y, length, width, height), and the label (h, w) of each pixel's box."""
    T = look_down(tilt, 0.7)
    frame, labels = render(boxes, T, noise)
    view = Frame(frame, (0.0, 2.0))
    plane = np.append(T[:3, :3].T @ [0.0, 0.0, 1.0], T[2, 3])
    image = view.working_image(plane)
    assert image is not None
    return Surfaces(image, plane), np.asarray(labels).reshape(image.shape)


def owners(surfaces: Surfaces, labels: np.ndarray) -> list[int]:
    """The box of each patch, of which it must be almost alone."""
    found = []
    for patch in range(1, surfaces.count + 1):
        inside = labels[surfaces.labels == patch]
        values, counts = np.unique(inside, return_counts=True)
        assert counts.max() > 0.9 * counts.sum() or counts.sum() < 50  # specks at edges are of both
        found.append(int(values[counts.argmax()]))
    return found


def test_planes_are_fitted_exactly_where_there_is_no_noise() -> None:
    surfaces, labels = surfaces_of([(0.0, 0.0, 0.16, 0.16, 0.1)])
    T = look_down(35.0, 0.7)
    asked = np.flatnonzero((labels >= 0) & (surfaces.image.inverse_depth > 0))
    fits = fit_surfaces(surfaces.image, asked)
    up = T[:3, :3].T @ [0.0, 0.0, 1.0]
    height = surfaces.height
    inside = height > 0.099  # the lid
    turned = np.degrees(np.arccos(np.clip(fits.normals[inside] @ up, -1, 1)))
    assert np.median(turned) < 0.5
    np.testing.assert_allclose(np.linalg.norm(fits.normals.reshape(-1, 3)[asked], axis=1), 1.0, atol=1e-5)


@pytest.mark.parametrize("noise", [0.0, 0.001])
def test_the_faces_of_boxes_that_touch_are_patches_of_one_box_each(noise: float) -> None:
    boxes = [(-0.05, 0.0, 0.1, 0.12, 0.08), (0.05, 0.04, 0.1, 0.12, 0.14)]
    surfaces, labels = surfaces_of(boxes, noise)
    found = owners(surfaces, labels)
    assert set(found) - {-1} == {0, 1}
    assert len(found) < 12
    pairs = set(zip(surfaces.borders.first.tolist(), surfaces.borders.second.tolist(), strict=True))
    assert any(found[i - 1] != found[j - 1] for i, j in pairs)
    assert np.isfinite(surfaces.near_features).all()


def test_the_two_ends_of_a_box_behind_another_are_a_pair() -> None:
    bar, post = (0.0, -0.04, 0.3, 0.04, 0.06), (0.0, 0.08, 0.06, 0.06, 0.14)
    surfaces, labels = surfaces_of([bar, post], tilt=55.0)
    found = owners(surfaces, labels)
    far = zip(surfaces.far_first.tolist(), surfaces.far_second.tolist(), strict=True)
    assert any(found[i - 1] == found[j - 1] == 0 for i, j in far)


def test_without_a_table_all_is_cut_and_what_needs_one_is_not_known() -> None:
    T = look_down(35.0, 0.7)
    frame, _ = render([(0.0, 0.0, 0.1, 0.1, 0.1)], T)
    image = Frame(frame, (0.0, 2.0)).working_image(None)
    assert image is not None
    surfaces = Surfaces(image, None)
    assert surfaces.count >= 2
    assert np.isnan(measures_of(surfaces.sums).heights).all()
    assert np.isnan(surfaces.near_features).any()


def test_an_empty_table_has_no_patches() -> None:
    surfaces, _ = surfaces_of([], noise=0.001)
    assert surfaces.count == 0
    assert len(surfaces.near_features) == len(surfaces.far_features) == 0


def test_the_sums_of_a_group_are_those_of_its_patches() -> None:
    boxes = [(-0.05, 0.0, 0.1, 0.12, 0.08), (0.05, 0.04, 0.1, 0.12, 0.14), (0.2, 0.0, 0.05, 0.05, 0.05)]
    surfaces, _ = surfaces_of(boxes, 0.001)
    found = surfaces.borders
    group = np.append(0, np.random.default_rng(0).integers(1, 5, surfaces.count))
    added = surfaces.sums.of_groups(group, found.first, found.second, found.adjoining)
    labels = group.astype(np.int32)[surfaces.labels]
    image, relief = surfaces.image, surfaces.relief
    assert relief is not None
    pixels = (surfaces.fits, surfaces.positions, labels, int(group.max()), surfaces.edge, surfaces.height)
    expected = add_up_patches(image, *pixels, surfaces.table, relief.above, relief.noise)
    np.testing.assert_allclose(added.sums, expected.sums, rtol=1e-9, atol=1e-9)
    np.testing.assert_array_equal(added.bins, expected.bins)
    np.testing.assert_array_equal(added.sides, expected.sides)


def test_parts_are_described_as_if_they_had_been_cut_so() -> None:
    boxes = [(-0.05, 0.0, 0.1, 0.12, 0.08), (0.05, 0.04, 0.1, 0.12, 0.14), (0.2, 0.0, 0.05, 0.05, 0.05)]
    surfaces, _ = surfaces_of(boxes, 0.001)
    part = np.append(0, np.random.default_rng(0).permutation(np.arange(surfaces.count) % 4 + 1))
    merged = surfaces.merged(part)
    np.testing.assert_array_equal(merged.labels, part[surfaces.labels])
    expected = borders(merged.labels, 4, (merged.labels == 0) & ~surfaces.table)

    def pixels(found: Borders) -> list[set[tuple[int, int, int]]]:
        rows = list(zip(found.inner.tolist(), found.outer.tolist(), found.steps.tolist(), strict=True))
        return [set(rows[a:b]) for a, b in zip(found.start[:-1], found.start[1:], strict=True)]

    assert pixels(merged.borders) == pixels(expected)
    for name in ("start", "first", "second", "adjoining"):
        np.testing.assert_array_equal(getattr(merged.borders, name), getattr(expected, name))
    crossing = part[surfaces.borders.first] != part[surfaces.borders.second]
    assert 0 < crossing.sum() < len(crossing)


def test_patches_that_stay_alone_are_described_as_before() -> None:
    surfaces, _ = surfaces_of([(-0.05, 0.0, 0.1, 0.12, 0.08), (0.05, 0.04, 0.1, 0.12, 0.14)], 0.001)
    alone = surfaces.merged(np.arange(surfaces.count + 1))
    np.testing.assert_allclose(alone.near_features, surfaces.near_features, rtol=1e-5, atol=1e-6)
    np.testing.assert_array_equal(alone.far_features, surfaces.far_features)
