"""The D435 model against known answers: pinhole geometry, the published noise formula, the stereo shadow's width."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pecgrasp_env.sensor import (
    BASELINE,
    D435,
    D435Noise,
    SensorError,
    apply_d435,
    apply_ideal,
    deproject,
    deproject_mask,
    intrinsics_of,
    min_depth,
)
from pecgrasp_env.sensor.d435_noise import correlated_normal, stereo_shadow

CAMERA = D435["424x240"]
QUIET = D435Noise(subpixel_error=0, edge_hole=0, edge_flying=0, patch_density=0)


def plane(z: float, camera=CAMERA) -> np.ndarray:
    return np.full((camera.height, camera.width), z, np.float32)


@pytest.mark.parametrize(
    ("resolution", "degrees"), [("424x240", 87), ("640x480", 75), ("848x480", 87), ("1280x720", 87)]
)
def test_intrinsics_have_the_field_of_view_of_the_data_sheet(resolution, degrees):
    camera = intrinsics_of(resolution)
    assert f"{camera.width}x{camera.height}" == resolution
    assert np.degrees(2 * np.arctan(camera.width / 2 / camera.fx)) == pytest.approx(degrees)
    assert np.degrees(2 * np.arctan(camera.height / 2 / camera.fy)) == pytest.approx(58, abs=3)
    assert camera.matrix @ (0, 0, 1) == pytest.approx((camera.width / 2, camera.height / 2, 1))


def test_unknown_resolution_is_named_with_the_ones_there_are():
    with pytest.raises(SensorError, match=r"'800x600'.*424x240"):
        min_depth("800x600")


def test_deprojected_plane_has_known_corners():
    cloud = deproject(plane(2.0), CAMERA)
    half_width = 2.0 * np.tan(np.radians(87) / 2)
    pixel = 2.0 / CAMERA.fx
    assert cloud.dtype == np.float32
    assert cloud[0, 0] == pytest.approx((-half_width + pixel / 2, -(120 - 0.5) * pixel, 2.0), abs=1e-6)
    assert cloud[239, 423] == pytest.approx((half_width - pixel / 2, (120 - 0.5) * pixel, 2.0), abs=1e-6)


@given(row=st.integers(0, 239), column=st.integers(0, 423), z=st.floats(0.11, 10))
def test_deprojection_inverts_projection(row, column, z):
    depth = np.zeros((240, 424), np.float32)
    depth[row, column] = z
    (point,) = deproject_mask(depth, depth > 0, CAMERA)
    projected = CAMERA.matrix @ point.astype(float)
    assert projected[:2] / projected[2] == pytest.approx((column + 0.5, row + 0.5), abs=1e-3)


def test_pixels_without_depth_give_no_point():
    depth = plane(1.0)
    depth[:, ::2] = 0
    depth[0, 1] = np.nan
    cloud = deproject(depth, CAMERA)
    assert np.isnan(cloud[depth == 0]).all()
    assert np.isnan(cloud[0, 1]).all()
    mask = np.ones(depth.shape, bool)
    assert np.array_equal(deproject_mask(depth, mask, CAMERA), cloud[np.isfinite(cloud[..., 2])])


def test_window_looks_along_the_rays_of_the_full_image():
    window = CAMERA.window(100, 50, 32, 64)
    whole = deproject(plane(0.7), CAMERA)[50:114, 100:132]
    assert deproject(plane(0.7, window), window) == pytest.approx(whole, abs=1e-6)


def test_ideal_sensor_changes_nothing_beyond_the_minimum_depth():
    depth = np.array([[0.0, 0.104, 0.105, 0.123456789]], np.float32)
    depth[0, 2] = min_depth("424x240")
    assert np.array_equal(apply_ideal(depth, CAMERA), np.where(depth >= CAMERA.min_depth, depth, 0))
    assert apply_ideal(depth, CAMERA)[0].tolist()[:2] == [0, 0]


@pytest.mark.parametrize("resolution", ["424x240", "848x480"])
@pytest.mark.parametrize("z", [0.4, 0.7, 1.0, 2.0])
def test_noise_grows_as_the_square_of_the_depth(z, resolution):
    camera = intrinsics_of(resolution)
    fine = D435Noise(disparity_step=1e-4, depth_unit=1e-5)  # without rounding, what the formula speaks of
    measured = apply_d435(plane(z, camera), camera, np.random.default_rng(1), fine)
    error = (measured - z)[measured > 0]
    published = z**2 * fine.subpixel_error / (camera.fx * BASELINE)
    # z = fB / d is convex in the disparity's noise: a mean error of published² / z, and tails that stretch as much.
    assert error.std() == pytest.approx(published, rel=0.03 + published / z)
    assert abs(error.mean()) < 0.05 * published + 2 * published**2 / z


@pytest.mark.parametrize("z", [0.4, 0.7, 1.0, 2.0])
def test_rounding_adds_to_the_noise_and_depth_is_whole_millimetres(z):
    noise = D435Noise()
    measured = apply_d435(plane(z), CAMERA, np.random.default_rng(1), noise)
    published = z**2 * noise.subpixel_error / (CAMERA.fx * BASELINE)
    disparity_rounding = z**2 * noise.disparity_step / (CAMERA.fx * BASELINE) / np.sqrt(12)
    expected = np.sqrt(published**2 + disparity_rounding**2 + noise.depth_unit**2 / 12)
    # The two roundings are not independent of each other: the sum of their variances is an estimate.
    assert (measured - z)[measured > 0].std() == pytest.approx(expected, rel=0.1)
    assert 1000 * measured == pytest.approx(np.rint(1000 * measured), abs=1e-3)


def test_noise_is_standard_normal_and_correlated_over_about_three_pixels():
    field = correlated_normal((400, 401), np.random.default_rng(0))
    assert field.shape == (400, 401)
    assert field.std() == pytest.approx(1, abs=0.03)
    assert field[::2, ::2].std() == pytest.approx(field[1::2, 1::2].std(), rel=0.03)
    assert 0.6 < np.mean(field[:, 1:] * field[:, :-1]) < 0.95
    assert 0.6 < np.mean(field[1:] * field[:-1]) < 0.95
    assert abs(np.mean(field[:, 5:] * field[:, :-5])) < 0.03


@pytest.mark.parametrize(("near", "far"), [(0.3, 0.5), (0.4, 1.0), (0.5, 2.0), (0.7, 0.8)])
def test_shadow_beside_a_step_is_one_baseline_wide_in_disparity(near, far):
    depth = plane(far)
    depth[60:180, 200:300] = near
    shadow = stereo_shadow(CAMERA.fx * BASELINE / depth)
    width = CAMERA.fx * BASELINE * (1 / near - 1 / far)
    inner = shadow[60:180, 50:]
    assert np.all(np.abs(inner.sum(axis=1) - width) <= 1)  # whole pixels
    columns = np.flatnonzero(inner[60]) + 50
    assert columns.max() == 199  # on the left of the object, touching it
    assert np.array_equal(columns, np.arange(columns[0], 200))
    assert not shadow[:60, 50:].any()  # no shadow above and below it
    # The right imager does not see the leftmost fx · B / far columns at all.
    assert np.all(np.abs(shadow[0].sum() - CAMERA.fx * BASELINE / far) <= 1)


def test_right_imager_sees_past_a_thin_object():
    depth = plane(0.6)
    depth[:, 200:203] = 0.3
    disparity = CAMERA.fx * BASELINE / depth
    shift = disparity.max() - disparity.min()
    columns = np.flatnonzero(stereo_shadow(disparity)[0, 50:]) + 50
    assert len(columns) <= 5  # its own width, not the 19 pixels between its two images
    assert columns.mean() == pytest.approx(201 - shift, abs=1.5)


@pytest.mark.parametrize("slope", [-1.0, -0.3, 0.3, 1.0])
def test_a_tilted_plane_casts_no_shadow_on_itself(slope):
    x = (np.arange(424) + 0.5 - CAMERA.cx) / CAMERA.fx
    depth = np.tile(0.6 / (1 - slope * x), (240, 1)).astype(np.float32)  # the plane z = 0.6 + slope · x
    depth[:, (depth[0] < 0.2) | (depth[0] > 5)] = 0
    shadow = stereo_shadow(CAMERA.fx * BASELINE * np.divide(1, depth, out=np.zeros_like(depth), where=depth > 0))
    assert not shadow[:, CAMERA.width // 2 :].any()


def test_a_window_has_the_shadow_of_the_full_image():
    depth = plane(0.8)
    depth[60:180, 200:300] = 0.4
    disparity = CAMERA.fx * BASELINE / depth
    assert np.array_equal(
        stereo_shadow(disparity[50:190, 10:350].copy(), first_column=10), stereo_shadow(disparity)[50:190, 10:350]
    )


@pytest.mark.parametrize(("degrees", "kept"), [(45, 1.0), (65, 1.0), (87, 0.0)])
def test_grazing_surfaces_are_lost(degrees, kept):
    y = (np.arange(240) + 0.5 - CAMERA.cy) / CAMERA.fy
    depth = np.tile((1.0 / (1 - np.tan(np.radians(degrees)) * y))[:, None], (1, 424)).astype(np.float32)
    measured = apply_d435(depth, CAMERA, np.random.default_rng(0), QUIET)
    middle = measured[119:121, 200:224]  # there the ray is along the axis, so the angle is the plane's own
    assert (middle > 0).mean() == kept


def test_pixels_at_an_edge_fly_between_the_surfaces_or_vanish():
    depth = plane(1.0)
    depth[:, 200:] = 0.5
    noise = D435Noise(subpixel_error=0, patch_density=0, edge_hole=0.3, edge_flying=0.3)
    measured = apply_d435(depth, CAMERA, np.random.default_rng(0), noise)
    edge = measured[:, 200]  # the near side: the far side lies in the shadow
    flying = (edge > 0.502) & (edge < 0.998)
    assert (edge == 0).mean() == pytest.approx(0.3, abs=0.1)
    assert flying.mean() == pytest.approx(0.3, abs=0.1)
    assert np.all((edge == 0) | ((edge > 0.49) & (edge < 1.02)))
    assert np.all(np.abs(measured[:, 202:] - 0.5) < 0.01)


def test_patches_are_missing_as_densely_as_asked():
    shares = []
    for density in (0.0, 10.0, 40.0):
        noise = D435Noise(
            subpixel_error=0, edge_hole=0, edge_flying=0, patch_density=density, patch_radius=(0.02, 0.02)
        )
        measured = apply_d435(plane(1.0), CAMERA, np.random.default_rng(0), noise)
        shares.append((measured[:, 20:] == 0).mean())
    assert shares[0] == 0
    # An ellipse covers π · 0.02² steradians; the 40 per steradian hardly overlap.
    assert shares[1] == pytest.approx(10 * np.pi * 0.02**2, rel=0.5)
    assert shares[2] == pytest.approx(40 * np.pi * 0.02**2, rel=0.3)


def test_a_seed_gives_one_frame_and_the_input_is_left_alone():
    depth = plane(0.6)
    depth[100:150, 100:200] = 0.45
    before = depth.copy()
    first, again, other = (apply_d435(depth, CAMERA, np.random.default_rng(seed)) for seed in (3, 3, 4))
    assert np.array_equal(first, again)
    assert not np.array_equal(first, other)
    assert np.array_equal(depth, before)
    assert first.dtype == np.float32


@given(st.floats(0.02, 9.0), st.integers(0, 100))
def test_measured_depth_is_a_hole_or_finite_and_beyond_the_minimum(z, seed):
    camera = CAMERA.window(200, 100, 20, 16)
    depth = plane(z, camera)
    depth[0, 0], depth[1, 1] = np.nan, np.inf
    measured = apply_d435(depth, camera, np.random.default_rng(seed))
    assert np.isfinite(measured).all()
    assert np.all((measured == 0) | (measured >= camera.min_depth))
    assert measured[0, 0] == measured[1, 1] == 0


def test_an_empty_frame_stays_empty():
    assert not apply_d435(plane(0.0), CAMERA, np.random.default_rng(0)).any()


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("subpixel_error", -0.1),
        ("depth_unit", 0),
        ("edge_hole", 0.9),
        ("grazing_start", 1.5),
        ("patch_radius", (0.2, 0.1)),
    ],
)
def test_noise_that_makes_no_sense_is_named(name, value):
    with pytest.raises(SensorError, match=name):
        D435Noise(**{name: value})
