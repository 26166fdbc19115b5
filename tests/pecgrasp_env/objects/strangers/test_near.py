"""Strangers made of the classes' own models."""

from __future__ import annotations

import numpy as np
import pytest

from pecgrasp_env.objects import make_object
from pecgrasp_env.objects.procedural.strangers.likeness import ALIKE, Likeness
from pecgrasp_env.objects.procedural.strangers.near import deformed, fragment, fused


def test_out_of_proportion_is_twice_or_a_third():
    model = make_object("stapler", 0)
    for seed in range(12):
        ratio = deformed(model, np.random.default_rng(seed)).extents / model.extents
        assert ratio.max() > 1.7 or ratio.min() < 0.45
        assert deformed(model, np.random.default_rng(seed)).extents.max() < 0.35


@pytest.mark.parametrize("name", ["box", "mouse", "mug"])
def test_a_fragment_is_smaller_and_closed_where_it_is_cut(name):
    model = make_object(name, 1)
    for seed in range(6):
        left = fragment(model, np.random.default_rng(seed))
        assert 0.02 * model.volume < left.volume < 0.7 * model.volume
        # A closed surface has no flux: areas times normals sum to nothing, here to within the hulls' fit.
        mesh = left.visual_mesh()
        flux = np.linalg.norm((mesh.face_normals * mesh.area_faces[:, None]).sum(axis=0))
        assert flux < 0.015 * mesh.area


def test_two_that_are_fused_stand_on_one_floor_and_leave_no_gap():
    a, b = make_object("mouse", 0), make_object("can", 0)
    for seed in range(6):
        both = fused(a, b, np.random.default_rng(seed))
        np.testing.assert_allclose(both.volume, a.volume + b.volume, rtol=1e-3)
        assert both.extents[:2].max() < a.extents[:2].max() + b.extents[:2].max() + 0.02
        assert both.extents[2] <= max(a.extents[2], b.extents[2]) + 1e-4


def test_likeness_is_of_shape_and_size_not_of_pose():
    members = [make_object("mouse", seed) for seed in range(12)]
    like = Likeness(members)
    assert like.to_nearest(members[3]) < 1e-9
    assert like.to_nearest(make_object("mouse", 50)) < ALIKE
    assert like.to_nearest(make_object("bottle", 0)) > ALIKE
    assert like.to_nearest(make_object("mug", 0)) > ALIKE
