"""Clouds of the free scenario against the geometry that they were rendered from."""

import re

import numpy as np
import pytest
import trimesh

from pec.data.shards import CloudSample, read_manifest, read_shard
from pecgrasp_env.capture import CaptureConfig, ObjectsConfig, generate
from pecgrasp_env.capture.rendering.depth_renderer import DepthRenderer, Shot
from pecgrasp_env.capture.scenarios.base import Subject
from pecgrasp_env.capture.scenarios.free import FreeScenario, random_pose
from pecgrasp_env.objects import ObjectModel, Part, make_object
from pecgrasp_env.sensor import D435, D435Noise


def block(x: float, y: float, z: float) -> ObjectModel:
    mesh = trimesh.creation.box((x, y, z))
    part = Part(mesh.vertices.astype(np.float32), mesh.faces.astype(np.int32), (1.0, 0.0, 0.0, 1.0))
    return ObjectModel("block", "block_0000", (part,), (part.vertices,), 0.1)


def captured(scenario, model: ObjectModel, count: int, first: int = 0) -> list[CloudSample]:
    made = scenario.capture([Subject(model, 0, 0)], first, count)
    assert not made.given_up
    assert len(made.samples) == count
    return made.samples


def in_object_frame(sample) -> np.ndarray:
    T = sample.T_camera_object.astype(float)
    return (sample.points - T[:3, 3]) @ T[:3, :3]


def test_cloud_of_a_block_lies_on_the_block():
    half = np.array([0.06, 0.04, 0.025])
    scenario = FreeScenario(CaptureConfig(resolutions=("848x480",)))
    for sample in captured(scenario, block(*(2 * half)), 40):
        outside = np.abs(in_object_frame(sample)) - half
        distance = np.linalg.norm(np.maximum(outside, 0), axis=1) + np.minimum(outside.max(axis=1), 0)
        assert np.abs(distance).max() < 1e-4


def test_cloud_is_what_rays_through_the_pixels_hit_first():
    model = make_object("stapler", 3)
    config = CaptureConfig(resolutions=("424x240",), max_depth=0.6, min_points=300)
    scenario = FreeScenario(config)
    mesh = model.visual_mesh()
    (sample,) = captured(scenario, model, 1)
    T = sample.T_camera_object.astype(float)
    triangles = mesh.vertices[mesh.faces] @ T[:3, :3].T + T[:3, 3]
    (camera,) = config.intrinsics
    projected = triangles[..., :2] / triangles[..., 2:] * (camera.fx, camera.fy) + (camera.cx, camera.cy)
    low, high = np.floor(projected.min((0, 1))).astype(int), np.ceil(projected.max((0, 1))).astype(int)
    columns, rows = np.meshgrid(np.arange(low[0], high[0]), np.arange(low[1], high[1]))
    rays = np.stack(
        [(columns + 0.5 - camera.cx) / camera.fx, (rows + 0.5 - camera.cy) / camera.fy, np.ones(rows.shape)], -1
    )
    depth = first_hits(rays.reshape(-1, 3), triangles).reshape(rows.shape)
    seen = np.zeros(rows.shape)
    pixels = sample.points[:, :2] / sample.points[:, 2:] * (camera.fx, camera.fy) + (camera.cx, camera.cy)
    at = np.floor(pixels).astype(int) - low
    seen[at[:, 1], at[:, 0]] = sample.points[:, 2]
    both = (seen > 0) & np.isfinite(depth)
    # The rasteriser snaps corners to 1/256 pixel: a few pixels on silhouettes and creases fall to the other side.
    assert both.sum() > 0.99 * max((seen > 0).sum(), np.isfinite(depth).sum())
    assert np.quantile(np.abs(seen - depth)[both], 0.99) < 1e-4


def first_hits(rays: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Depth (N,) at which rays (N, 3) with z = 1 from the origin first meet triangles (F, 3, 3), or inf."""
    a, ab, ac = triangles[:, 0], triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    q = np.cross(-a, ab)
    depth = np.full(len(rays), np.inf)
    for index, ray in enumerate(rays):
        p = np.cross(ray, ac)
        determinant = np.einsum("ij,ij->i", ab, p)
        with np.errstate(divide="ignore", invalid="ignore"):
            u = np.einsum("ij,ij->i", -a, p) / determinant
            v = q @ ray / determinant
            t = np.einsum("ij,ij->i", ac, q) / determinant
        hit = (u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0)
        depth[index] = t[hit].min(initial=np.inf)
    return depth


def test_a_window_shows_what_the_full_frame_shows():
    renderer, camera = DepthRenderer(2.0), D435["424x240"]
    renderer.show([make_object("stapler", 1)])
    T = np.eye(4)
    T[:3, 3] = 0.13, -0.05, 0.55
    frame = renderer.render(Shot(0, T, camera, renderer.extent(0, T, camera)))
    part, window = frame.depth, frame.intrinsics
    assert window.width < 200
    whole = renderer.render_window(camera).depth
    assert whole.shape == (240, 424)
    left, top = window.first_column, int(camera.cy - window.cy)
    assert (part > 0).sum() == (whole > 0).sum() > 500
    assert part == pytest.approx(whole[top : top + window.height, left : left + window.width], abs=2e-5)


def test_rotations_are_uniform_and_positions_uniform_in_the_frustum():
    camera = D435["424x240"]
    rng = np.random.default_rng(0)
    poses = np.array([random_pose(camera, 2.0, rng) for _ in range(4000)])
    rotations = poses[:, :3, :3]
    assert np.linalg.det(rotations) == pytest.approx(np.ones(4000))
    # Of a uniform rotation every entry is uniform on [-1, 1] (Archimedes): mean 0, variance 1/3.
    assert np.abs(rotations.mean(0)).max() < 0.04
    assert rotations.var(0) == pytest.approx(np.full((3, 3), 1 / 3), abs=0.02)
    x, y, z = poses[:, :3, 3].T
    near = camera.min_depth
    share = np.mean(z < 1.0)
    assert share == pytest.approx((1 - near**3) / (8 - near**3), abs=0.02)  # an eighth of the volume is within 1 m
    for along, size, focal in ((x, camera.width, camera.fx), (y, camera.height, camera.fy)):
        place = along / z * focal / size
        assert np.abs(place).max() <= 0.5
        assert place.var() == pytest.approx(1 / 12, abs=0.005)


def test_d435_clouds_are_noisy_as_the_depth_says():
    noise = D435Noise(edge_hole=0, edge_flying=0, patch_density=0, grazing_start=1.5, grazing_end=1.57)
    config = CaptureConfig(sensor="d435", noise=noise, resolutions=("848x480",), min_points=100)
    scenario = FreeScenario(config)
    half = np.array([0.1, 0.1, 0.1])
    (camera,), ratios = config.intrinsics, []
    for sample in captured(scenario, block(*(2 * half)), 60):
        local, T = in_object_frame(sample), sample.T_camera_object
        # Along the ray, a face whose normal makes the angle a with it is error · cos(a) away from the measured point.
        axis = np.argmax(np.abs(local), axis=1)
        face = np.sign(np.take_along_axis(local, axis[:, None], 1)[:, 0]) * 0.1
        normal = T[:3, :3].T[axis].astype(float)
        rays = sample.points / sample.points[:, 2:]
        off = np.take_along_axis(local, axis[:, None], 1)[:, 0] - face
        inner = np.sort(np.abs(local), axis=1)[:, 1] < 0.08  # away from edges, where the face is not in doubt
        along = np.einsum("ij,ij->i", normal, rays)
        error = off[inner] / along[inner]
        z = sample.points[inner, 2]
        ratios.append(error / (z**2 * noise.subpixel_error / (camera.fx * 0.05)))
    assert np.median(np.abs(np.concatenate(ratios))) == pytest.approx(0.674, rel=0.15)  # of a normal distribution


def test_several_cameras_take_turns_and_are_listed(tmp_path):
    objects = ObjectsConfig(classes=("can", "plug_adapter"), instances_per_class=2)
    config = CaptureConfig(objects=objects, samples_per_instance=12, resolutions=("424x240", "848x480"), seed=7)
    manifest = read_manifest(generate(config, tmp_path / "data", workers=1).directory)
    assert [camera["name"] for camera in manifest.cameras] == ["424x240", "848x480"]
    assert manifest.cameras[1]["width"] == 848
    shards = [read_shard(tmp_path / "data" / record.file, record) for record in manifest.shards]
    taken = np.concatenate([shard.camera for shard in shards])
    assert 10 < taken.sum() < 38  # of 48
    for shard in shards:
        for i in range(len(shard)):
            camera = D435[manifest.cameras[shard.camera[i]]["name"]]
            points = shard.cloud(i).astype(float)
            pixels = points[:, :2] / points[:, 2:] * (camera.fx, camera.fy) + (camera.cx, camera.cy)
            assert np.abs(pixels % 1 - 0.5).max() < 0.01  # each point lies on the ray of a pixel of its own camera


def test_an_object_in_millimetres_is_told_from_one_in_metres():
    made = FreeScenario(CaptureConfig()).capture([Subject(block(120, 80, 50), 0, 0)], 0, 1)
    assert re.search(r"block_0000 is 120 m long.*objects\.scale", made.given_up["block/block_0000"])


def test_an_object_that_never_has_enough_points_is_given_up_with_the_reasons():
    scenario = FreeScenario(CaptureConfig(min_points=300_000, resolutions=("424x240",)))
    made = scenario.capture([Subject(block(0.1, 0.1, 0.1), 0, 0)], 0, 1)
    assert not made.samples
    assert re.search(r"none of 2000 poses gave a cloud .*too few points: \d+", made.given_up["block/block_0000"])
