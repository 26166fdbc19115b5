"""Cameras: a RealSense through its real library on a software device, recorded frames, ROS bags, the mean of frames."""

from __future__ import annotations

import importlib.util
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pecgrasp_env.real.camera.averaging import mean_depth
from pecgrasp_env.real.camera.bag import BagCamera
from pecgrasp_env.real.camera.realsense import DepthFilters, RealSenseCamera, first_device, infrared_image
from pecgrasp_env.real.camera.recorded import RecordedCamera, write_depth_image
from pecgrasp_env.real.errors import ConnectionLost, MissingExtra, RobotError
from pecgrasp_env.real.fakes.realsense_device import SoftwareRealSense
from pecgrasp_env.real.interfaces import DepthCamera, DepthImage
from pecgrasp_env.sensor.intrinsics import CameraIntrinsics, deproject


def loads(module: str) -> bool:
    try:
        return importlib.util.find_spec(module) is not None and bool(importlib.import_module(module))
    except ImportError:
        return False


needs_realsense = pytest.mark.skipif(not loads("pyrealsense2"), reason="pip install '.[realsense]' and libusb-1.0")
needs_rosbags = pytest.mark.skipif(not loads("rosbags"), reason="pip install '.[rosbags]'")
CAMERA = CameraIntrinsics(64, 48, 60.0, 61.0, 32.5, 23.25)


def step(noise: float = 0.0) -> np.ndarray:
    """A box 0.5 m away before a wall at 0.8 m, with a hole in each, and `noise` m."""
    depth = np.full((48, 64), 0.8)
    depth[12:36, 20:44] = 0.5
    depth[5:8, 5:8] = depth[20:23, 30:33] = 0
    return depth + np.where(depth > 0, noise * np.random.default_rng(0).standard_normal(depth.shape), 0)


@pytest.fixture
def software() -> Iterator[SoftwareRealSense]:
    fake = SoftwareRealSense(step, CAMERA, infrared=lambda: (np.arange(48 * 64) % 251).astype(np.uint8).reshape(48, 64))
    yield fake
    fake.close()


@needs_realsense
def test_depth_comes_through_the_real_library_as_it_went_in(software):
    with RealSenseCamera(software.device, "64x48", frames=3, filters=DepthFilters(spatial=False)) as camera:
        assert isinstance(camera, DepthCamera)
        software.run()
        first, second = camera.grab(), camera.grab()
    np.testing.assert_allclose(first.depth, step(), atol=1e-6)
    assert first.depth.dtype == np.float32
    assert (first.intrinsics.cx, first.intrinsics.cy) == pytest.approx((CAMERA.cx, CAMERA.cy), abs=1e-4)
    assert (first.intrinsics.fx, first.intrinsics.fy) == pytest.approx((CAMERA.fx, CAMERA.fy), abs=1e-4)
    assert second.time > first.time


@needs_realsense
@pytest.mark.parametrize("unit", [1e-3, 1e-4])
def test_the_unit_of_depth_is_the_devices_own(unit):
    fake = SoftwareRealSense(lambda: np.full((48, 64), 0.4321), CAMERA, depth_unit=unit)
    with RealSenseCamera(fake.device, "64x48", frames=1, filters=DepthFilters(spatial=False)) as camera:
        assert camera.depth_scale == pytest.approx(unit)
        fake.run()
        assert np.abs(camera.grab().depth - 0.4321).max() <= unit / 2 + 1e-6
    fake.close()


@needs_realsense
def test_our_filters_smooth_a_surface_keep_its_edge_and_fill_no_hole(software):
    noisy = SoftwareRealSense(lambda: step(0.003), CAMERA)
    with RealSenseCamera(noisy.device, "64x48", frames=1) as camera:
        noisy.run()
        depth = camera.grab().depth
    noisy.close()
    assert (depth[5:8, 5:8] == 0).all()
    assert (depth[20:23, 30:33] == 0).all()
    inside = depth[24:34, 22:42]
    assert inside.std() < 0.6 * step(0.003)[24:34, 22:42].std()
    beside = depth[24:34, [18, 19, 20, 21]]
    assert np.minimum(np.abs(beside - 0.8), np.abs(beside - 0.5)).max() < 0.02  # nothing flies between


@needs_realsense
def test_frames_from_before_the_call_are_not_used():
    distance = 0.3
    fake = SoftwareRealSense(lambda: np.full((48, 64), distance), CAMERA, rate=0)
    with RealSenseCamera(fake.device, "64x48", frames=1) as camera:
        for _ in range(3):
            fake.send()
        distance = 0.7
        fake.run()
        assert camera.grab().depth[20, 20] == pytest.approx(0.7, abs=1e-3)
    fake.close()


@needs_realsense
def test_the_left_infrared_image_is_read_for_calibration(software):
    software.run()
    image, intrinsics = infrared_image(software.device, "64x48")
    assert (image == (np.arange(48 * 64) % 251).astype(np.uint8).reshape(48, 64)).all()
    assert (intrinsics.width, intrinsics.height) == (64, 48)


@needs_realsense
def test_what_a_camera_lacks_is_named(software, monkeypatch):
    with pytest.raises(RobotError, match=r"resolution=640x480: the camera's depth has 64x48"):
        RealSenseCamera(software.device, "640x480")
    with pytest.raises(RobotError, match=r"frames=0"):
        RealSenseCamera(software.device, "64x48", frames=0)
    with pytest.raises(ConnectionLost, match="no RealSense camera is plugged in"):
        first_device()
    monkeypatch.setattr("pecgrasp_env.real.camera.realsense._WAIT_MS", 20)
    with (
        RealSenseCamera(software.device, "64x48") as camera,
        pytest.raises(ConnectionLost, match=r"no frame from the camera within 0\.02 s"),
    ):
        camera.grab()


@pytest.mark.parametrize(
    ("module", "make"), [("pyrealsense2", RealSenseCamera), ("rosbags.highlevel", lambda: BagCamera("."))]
)
def test_a_missing_library_names_its_extra(module, make, monkeypatch):
    import sys

    monkeypatch.setitem(sys.modules, module, None)
    extra = {"pyrealsense2": "realsense", "rosbags.highlevel": "rosbags"}[module]
    with pytest.raises(MissingExtra, match=rf"{module}.*pecgrasp\[{extra}\]"):
        make()


def test_recorded_frames_come_back_in_order(tmp_path: Path):
    images = [DepthImage((step() + 0.01 * k).astype(np.float32), CAMERA, 0.1 * k) for k in range(3)]
    for k, image in enumerate(images):
        write_depth_image(tmp_path / f"frame_{k}.npz", image)
    camera = RecordedCamera(tmp_path)
    assert isinstance(camera, DepthCamera)
    for image in images:
        read = camera.grab()
        np.testing.assert_allclose(read.depth, image.depth, atol=6e-5)
        assert read.intrinsics == CAMERA
        assert read.time == pytest.approx(image.time)
    with pytest.raises(ConnectionLost, match="last of 3 recorded frames"):
        camera.grab()


def test_a_recorded_frame_is_the_cloud_that_plan_reads(tmp_path: Path):
    from grasping.cloud_files import read_cloud

    write_depth_image(tmp_path / "a.npz", DepthImage(step().astype(np.float32), CAMERA, 0.0))
    image = RecordedCamera(tmp_path).grab()
    np.testing.assert_allclose(read_cloud(tmp_path / "a.npz"), deproject(image.depth, image.intrinsics), atol=1e-6)


@pytest.mark.parametrize(
    ("arrays", "words"),
    [
        ({"depth": np.ones((4, 4))}, "K"),
        ({"depth": np.ones(4), "K": np.eye(3)}, r"shape \(4,\): numbers \(H, W\)"),
        ({"depth": np.ones((48, 64)), "K": np.eye(3)}, "focal lengths 1 and 1"),
    ],
)
def test_files_that_hold_no_frame_are_named(arrays, words, tmp_path: Path):
    with pytest.raises(RobotError, match="no frames"):
        RecordedCamera(tmp_path)
    np.savez(tmp_path / "a.npz", **arrays)
    with pytest.raises(RobotError, match=rf"a.npz: .*{words}"):
        RecordedCamera(tmp_path).grab()


def write_bag(path: Path, kind: str, encoding: str, depth: np.ndarray) -> Path:
    """Two frames, the second 1 s and 0.1 m later, with a CameraInfo and a colour image beside them."""
    from rosbags.rosbag1 import Writer as Writer1
    from rosbags.rosbag2 import StoragePlugin
    from rosbags.rosbag2 import Writer as Writer2
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC if kind == "bag" else Stores.ROS2_HUMBLE)
    types = store.types
    Header, Time = types["std_msgs/msg/Header"], types["builtin_interfaces/msg/Time"]
    Image, Info, Roi = (types[f"sensor_msgs/msg/{name}"] for name in ("Image", "CameraInfo", "RegionOfInterest"))
    serialise = store.serialize_ros1 if kind == "bag" else store.serialize_cdr
    if kind == "bag":
        writer = Writer1(path)
    else:
        plugin = StoragePlugin.MCAP if kind == "mcap" else StoragePlugin.SQLITE3
        writer = Writer2(path, version=8, storage_plugin=plugin)
    K = np.array([60.0, 0, 32.0, 0, 61.0, 22.75, 0, 0, 1])
    names = ("K", "D", "R", "P") if kind == "bag" else ("k", "d", "r", "p")
    matrices = dict(zip(names, (K, np.zeros(5), np.eye(3).ravel(), np.zeros(12)), strict=True))
    with writer:
        links = {
            topic: writer.add_connection(topic, message.__msgtype__, typestore=store)
            for topic, message in (
                ("/c/depth/image", Image),
                ("/c/depth/camera_info", Info),
                ("/c/rgb/image", Image),
            )
        }
        for k in range(2):
            sequence = {"seq": k} if kind == "bag" else {}
            header = Header(stamp=Time(sec=5 + k, nanosec=500_000_000), frame_id="c", **sequence)
            pixels = depth + 0.1 * k * (depth > 0)
            raw = (1e3 * pixels).round().astype("<u2") if encoding == "16UC1" else pixels.astype("<f4")
            data = np.frombuffer(raw.tobytes(), np.uint8)
            info = Info(header=header, height=48, width=64, distortion_model="plumb_bob", binning_x=0, binning_y=0,
                        roi=Roi(0, 0, 0, 0, False), **matrices)  # fmt: skip
            image = Image(header, 48, 64, encoding, 0, 64 * raw.itemsize, data)
            colour = Image(header, 1, 1, "rgb8", 0, 3, np.zeros(3, np.uint8))
            for topic, message in zip(links, (image, info, colour), strict=True):
                content = serialise(message, message.__msgtype__)
                writer.write(links[topic], (5 + k) * 10**9, content)
    return path


@needs_rosbags
@pytest.mark.parametrize(("kind", "encoding"), [("bag", "16UC1"), ("sqlite", "32FC1"), ("mcap", "16UC1")])
def test_a_bags_depth_images_come_as_frames(kind, encoding, tmp_path: Path):
    path = write_bag(tmp_path / ("frames.bag" if kind == "bag" else "frames"), kind, encoding, step())
    camera = BagCamera(path)
    assert isinstance(camera, DepthCamera)
    assert camera.intrinsics == CAMERA
    first, second = camera.grab(), camera.grab()
    np.testing.assert_allclose(first.depth, step(), atol=1e-6)
    np.testing.assert_allclose(second.depth, np.where(step() > 0, step() + 0.1, 0), atol=1e-6)
    assert (first.time, second.time) == (5.5, 6.5)
    with pytest.raises(ConnectionLost, match="no more frames"):
        camera.grab()
    camera.close()


@needs_rosbags
def test_what_a_bag_lacks_is_named(tmp_path: Path):
    path = write_bag(tmp_path / "frames", "mcap", "32FC1", step())
    with pytest.raises(RobotError, match=r"topic=/x: say which of its images is depth: /c/depth/image, /c/rgb/image"):
        BagCamera(path, "/x")
    with pytest.raises(RobotError, match=r"no /c/rgb/camera_info: the intrinsics of /c/rgb/image are wanted"):
        BagCamera(path, "/c/rgb/image")
    with pytest.raises(RobotError, match="there is no such bag"):
        BagCamera(tmp_path / "none.bag")


@given(st.integers(1, 9), st.integers(0, 1000))
def test_the_mean_of_equal_frames_is_the_frame(count, seed):
    frame = np.where(np.random.default_rng(seed).random((5, 7)) < 0.3, 0, 0.5).astype(np.float32)
    assert (mean_depth(np.array([frame] * count)) == frame).all()


def test_a_mean_averages_noise_and_invents_no_surface():
    rng = np.random.default_rng(0)
    frames = 0.6 + 0.002 * rng.standard_normal((8, 40, 50))
    frames[:, 0] = np.where(np.arange(8)[:, None] % 3 == 0, 0.6, 0.9)  # an edge: now here, now there
    frames[:3, 1], frames[:5, 2] = 0, np.nan
    mean = mean_depth(frames)
    assert np.abs(mean[3:] - 0.6).max() < 0.004
    assert mean[3:].std() < 0.001
    assert set(np.unique(mean[0]).round(3)) == {np.float32(0.9).round(3)}
    assert (mean[1] > 0.5).all()  # seen in five of eight
    assert (mean[2] == 0).all()  # in three
