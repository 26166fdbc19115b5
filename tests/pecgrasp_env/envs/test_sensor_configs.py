"""ManiSkill's `sensor_configs` on the wrist camera: sizes, fields of view and intrinsics, and what is refused."""

import gymnasium as gym
import numpy as np
import pytest

import pecgrasp_env  # noqa: F401  (registers the task)
from pecgrasp_env.sensor import D435, SensorError
from pecgrasp_env.sensor.maniskill_camera import camera_overrides

MAKE = {"render_backend": "cpu", "sim_backend": "physx_cpu", "n_objects": 2}
_F = D435["424x240"].fx


def observed(mode, configs, **kwargs):
    env = gym.make("SelectiveGrasp-v1", obs_mode=mode, sensor_configs=configs, **(MAKE | kwargs))
    obs, _ = env.reset(seed=2)
    space = env.observation_space
    env.close()
    camera = {name: image[0].numpy() for name, image in obs["sensor_data"]["wrist_camera"].items()}
    assert all(space["sensor_data"]["wrist_camera"][name].shape[1:] == image.shape for name, image in camera.items())
    return camera, obs["sensor_param"]["wrist_camera"]["intrinsic_cv"][0].numpy()


@pytest.mark.parametrize(
    ("configs", "size", "K"),
    [
        ({"width": 212, "height": 120}, (212, 120), (_F / 2, _F / 2, 106, 60)),
        ({"wrist_camera": {"width": 96, "height": 96}}, (96, 96), (_F * 96 / 424, _F * 96 / 424, 48, 48)),
        ({"width": 64, "wrist_camera": {"width": 96}}, (96, 240), (_F * 96 / 424, _F * 96 / 424, 48, 120)),
        ({"width": 80, "height": 60, "fov": 0.8}, (80, 60), (30 / np.tan(0.4), 30 / np.tan(0.4), 40, 30)),
        (
            {"width": 80, "height": 60, "intrinsic": [[50, 0, 30], [0, 55, 35], [0, 0, 1]]},
            (80, 60),
            (50, 55, 30, 35),
        ),
    ],
)
def test_what_is_rendered_has_the_size_and_the_rays_that_are_said(configs, size, K):
    images, matrix = observed("position+depth", configs)
    fx, fy, cx, cy = K
    assert np.allclose(matrix, [[fx, 0, cx], [0, fy, cy], [0, 0, 1]], rtol=1e-5)
    assert images["depth"].shape == (size[1], size[0], 1)
    x, y, z = np.moveaxis(images["position"] * [1, -1, -1], 2, 0)
    u, v = np.meshgrid(np.arange(size[0]) + 0.5, np.arange(size[1]) + 0.5)
    assert (z > 0).mean() > 0.9
    seen = z > 0
    assert np.allclose((x / z * fx + cx - u)[seen], 0, atol=0.01)
    assert np.allclose((y / z * fy + cy - v)[seen], 0, atol=0.01)


def test_half_the_size_is_the_same_view():
    whole, _ = observed("segmentation", None)
    half, _ = observed("segmentation", {"width": 212, "height": 120})
    corners = [whole["segmentation"][i::2, j::2] for i in (0, 1) for j in (0, 1)]
    inside = np.all([corner == corners[0] for corner in corners], axis=0)
    assert inside.mean() > 0.9
    assert (half["segmentation"] == corners[0])[inside].mean() > 0.999


@pytest.mark.slow  # compiles another shader
def test_the_camera_sees_what_is_between_near_and_far():
    images, _ = observed("rgb+depth", {"near": 0.2, "far": 3.0, "width": 64, "height": 48})
    plain, _ = observed("depth", {"width": 64, "height": 48})
    assert np.median(images["depth"]) == pytest.approx(np.median(plain["depth"]), abs=1e-4)


@pytest.mark.slow  # compiles another shader
def test_normals_and_colours_without_light():
    """The camera looks straight down: the table's normal points at it."""
    images, _ = observed("normal+albedo+depth", {"width": 64, "height": 48}, joint_noise=0.0, sensor="d435")
    normals = images["normal"].reshape(-1, 3)
    assert np.allclose(np.median(normals, axis=0), [0, 0, 1], atol=1e-2)
    assert images["albedo"].dtype == np.uint8
    assert np.ptp(images["albedo"]) > 50
    assert 0.2 < np.median(images["depth"]) < 1.0


@pytest.mark.parametrize(
    ("configs", "words"),
    [
        ({"widht": 64}, "widht=64.*width, height"),
        ({"width": 0}, "width=0"),
        ({"height": 64.5}, "height=64.5"),
        ({"fov": 90}, "fov=90.*radians"),
        ({"fov": 1.0, "intrinsic": np.eye(3)}, "fov and intrinsic"),
        ({"intrinsic": [[50, 0, 0], [0, 50, 0], [30, 30, 1]]}, "intrinsic="),
        ({"intrinsic": [[50, 0, 900], [0, 50, 30], [0, 0, 1]]}, "principal point"),
        ({"near": 2.0, "far": 1.0}, "near=2.0, far=1.0"),
        ({"shader_pack": "toon"}, "shader_pack='toon'.*minimal"),
        ({"use_stereo_depth": True}, "sensor='d435'"),
        ({"wrist_camera": 64}, "must be a dictionary"),
    ],
)
def test_settings_that_make_no_sense_are_named(configs, words):
    with pytest.raises(SensorError, match=words):
        camera_overrides(D435["424x240"], ["depth"], configs)


def test_a_shader_without_normals_is_refused_for_them():
    with pytest.raises(SensorError, match=r"'minimal'.*normal"):
        camera_overrides(D435["424x240"], ["normal"], {"shader_pack": "minimal"})
