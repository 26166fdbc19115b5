"""A structured-light camera's faults, on planes and a box."""

import numpy as np
import pytest

from pecgrasp_env.sensor import SensorError
from pecgrasp_env.sensor.structured_light_noise import (
    STRUCTURED_LIGHT,
    StructuredLightNoise,
    apply_structured_light,
    lost_regions,
)

CAMERA = STRUCTURED_LIGHT["640x480"]
WALL = np.full((480, 640), 1.0, np.float32)
INSIDE = (slice(20, -20), slice(20, -20))


def box_before_a_wall():
    depth = np.full((480, 640), 1.2, np.float32)
    depth[150:350, 250:400] = 0.7
    return depth


def test_one_seed_gives_one_frame():
    first, source = apply_structured_light(box_before_a_wall(), CAMERA, np.random.default_rng(3))
    again, _ = apply_structured_light(box_before_a_wall(), CAMERA, np.random.default_rng(3))
    other, _ = apply_structured_light(box_before_a_wall(), CAMERA, np.random.default_rng(4))
    np.testing.assert_array_equal(first, again)
    assert (first != other).any()
    assert first.dtype == np.float32
    assert source.shape == first.shape


def test_disparity_comes_in_eighths_of_a_pixel_and_errs_as_measured_on_real_tables():
    exact = WALL * np.linspace(0.98, 1.02, 640, dtype=np.float32)
    measured, _ = apply_structured_light(exact, CAMERA, np.random.default_rng(0))
    disparity = CAMERA.fx * 0.075 / measured[INSIDE]
    assert np.abs(disparity * 8 - np.rint(disparity * 8)).max() < 0.4  # but for depth's whole millimetres
    error = (disparity - CAMERA.fx * 0.075 / exact[INSIDE])[:, :]
    assert 0.06 < error.std() < 0.11
    neighbours = np.corrcoef(error[:, :-1].ravel(), error[:, 1:].ravel())[0, 1]
    far = np.corrcoef(error[:, :-8].ravel(), error[:, 8:].ravel())[0, 1]
    assert 0.6 < neighbours < 0.95
    assert abs(far) < 0.1


def test_the_shadow_lies_beside_the_left_border_only():
    measured, _ = apply_structured_light(box_before_a_wall(), CAMERA, np.random.default_rng(0))
    width = CAMERA.fx * 0.075 * (1 / 0.7 - 1 / 1.2)  # 23 px
    rows = slice(170, 330)
    left = measured[rows, 250 - round(width) + 3 : 250 - 3]
    right = measured[rows, 405:425]
    assert (left == 0).mean() > 0.9
    assert (right == 0).mean() < 0.1


def test_borders_move_by_about_a_pixel_and_masks_go_with_them():
    exact = box_before_a_wall()
    measured, source = apply_structured_light(exact, CAMERA, np.random.default_rng(1))
    mask = (exact < 1).reshape(-1)[source]
    seen = measured > 0
    assert ((measured < 0.95) == mask)[seen].all()
    moved = mask != (exact < 1)
    assert 0 < moved.sum() < 4 * (200 + 150)
    assert not moved[160:340, 260:390].any()


def test_dark_things_lose_their_share_in_regions():
    lost = np.zeros((480, 640), np.float32)
    lost[:, 320:] = 0.5
    measured, _ = apply_structured_light(WALL, CAMERA, np.random.default_rng(2), lost=lost)
    hole = measured == 0
    assert hole[:, 20:310].mean() < 0.01
    assert 0.4 < hole[:, 330:-20].mean() < 0.6
    inside = hole[:, 340:-20]
    assert (inside[:, 1:] == inside[:, :-1]).mean() > 0.8  # single pixels would agree in half of the cases
    assert not lost_regions(np.zeros((48, 64)), np.random.default_rng(0)).any()
    assert lost_regions(np.ones((48, 64)), np.random.default_rng(0)).all()


def test_grazing_surfaces_and_what_is_out_of_range_are_not_measured():
    q = np.linspace(40, 4, 480, dtype=np.float32)[:, None] / (CAMERA.fx * 0.075)
    steep = np.broadcast_to(1 / q, (480, 640)).astype(np.float32)  # a floor that runs off to 10 m
    measured, _ = apply_structured_light(steep, CAMERA, np.random.default_rng(0))
    assert (measured[steep > 5.5] == 0).all()
    near, _ = apply_structured_light(np.full_like(WALL, 0.3), CAMERA, np.random.default_rng(0))
    assert not near.any()


def test_nonsense_is_refused():
    with pytest.raises(SensorError, match="disparity_step must be positive"):
        StructuredLightNoise(disparity_step=0)
    with pytest.raises(SensorError, match="grazing_start < grazing_end"):
        StructuredLightNoise(grazing_start=1.5)
    empty, _ = apply_structured_light(np.zeros((480, 640), np.float32), CAMERA, np.random.default_rng(0))
    assert not empty.any()
