"""A look with each kind of camera, by the command, through the stand-in's sockets; and pictures for calibration."""

import json
import sys

import numpy as np
import pytest

pytest.importorskip("rtde_control", reason="pip install 'pecgrasp[ur]'")
pytest.importorskip("rosbags", reason="pip install 'pecgrasp[rosbags]'")

from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from pecgrasp.cli import main
from pecgrasp_env.real import DepthImage, MissingExtra
from pecgrasp_env.real.calibration.board import Board
from pecgrasp_env.real.camera import realsense as driver
from pecgrasp_env.real.camera.realsense import realsense
from pecgrasp_env.real.camera.recorded import read_depth_image, write_depth_image
from pecgrasp_env.real.fakes.board_images import draw_board
from pecgrasp_env.real.fakes.realsense_device import SoftwareRealSense
from pecgrasp_env.real.ur import URArm
from pecgrasp_env.robot.camera_mount import read_mount
from pecgrasp_env.robot.kinematics import HOME, T_TOOL0_CAMERA, forward_kinematics
from pecgrasp_env.sensor.intrinsics import intrinsics_of

PATIENCE_S = 60.0
CAMERA = intrinsics_of("424x240")
T_BASE_CAMERA = forward_kinematics(HOME) @ T_TOOL0_CAMERA
BOX = (0.5, 0.02, 0.025, 0.05)  # x, y, half its side and its height, m

try:
    HAS_REALSENSE = bool(realsense())
except MissingExtra:
    HAS_REALSENSE = False


def depth_of_box():
    """(H, W) m: what the wrist camera sees of a box on the table from the home posture."""
    x, y, half, height = BOX
    v, u = np.indices((CAMERA.height, CAMERA.width)) + 0.5
    rays = np.stack([(u - CAMERA.cx) / CAMERA.fx, (v - CAMERA.cy) / CAMERA.fy, np.ones_like(u)], axis=-1)
    rays, eye = rays @ T_BASE_CAMERA[:3, :3].T, T_BASE_CAMERA[:3, 3]
    top = (height - eye[2]) / rays[..., 2]
    hit = eye + top[..., None] * rays
    on_top = (np.abs(hit[..., 0] - x) < half) & (np.abs(hit[..., 1] - y) < half)
    return np.where(on_top, top, -eye[2] / rays[..., 2]).astype(np.float32)


@pytest.fixture(scope="module")
def host(hosts, fake_robot):
    host = hosts()
    with fake_robot(host, "scene=joints"):
        yield host


def run(command, *overrides):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", ["pecgrasp", command, *overrides])
        main()


def look(host, out, *camera):
    common = [f"host={host}", "target=box", "checkpoint=null", f"patience={PATIENCE_S}", f"output={out}"]
    run("pick", *common, *camera)
    decision = json.loads((out / "decisions.jsonl").read_text())
    assert decision["chosen"] == 0
    assert decision["objects"][0]["place"][:2] == pytest.approx(BOX[:2], abs=0.006)
    assert decision["T_base_grasp"] is not None
    assert (out / "pick.html").exists()


def test_a_recorded_folder_looks_and_what_a_look_has_left_is_one(host, tmp_path):
    (tmp_path / "frames").mkdir()
    write_depth_image(tmp_path / "frames" / "0.npz", DepthImage(depth_of_box(), CAMERA, 0.0))
    look(host, tmp_path / "first", "camera=recorded", f"camera.folder={tmp_path}/frames")
    look(host, tmp_path / "again", "camera=recorded", f"camera.folder={tmp_path}/first/frames")
    again = read_depth_image(tmp_path / "again" / "frames" / "000.npz")
    assert (again.intrinsics.cx, again.intrinsics.cy) == pytest.approx((CAMERA.cx, CAMERA.cy))


def test_a_bag_looks(host, tmp_path):
    store = get_typestore(Stores.ROS2_HUMBLE)
    types = store.types
    header = types["std_msgs/msg/Header"](types["builtin_interfaces/msg/Time"](5, 0), "camera")
    pixels = np.frombuffer((1e3 * depth_of_box()).round().astype("<u2").tobytes(), np.uint8)
    K = np.array([CAMERA.fx, 0, CAMERA.cx - 0.5, 0, CAMERA.fy, CAMERA.cy - 0.5, 0, 0, 1])
    roi = types["sensor_msgs/msg/RegionOfInterest"](0, 0, 0, 0, False)
    size = (CAMERA.height, CAMERA.width)
    info = types["sensor_msgs/msg/CameraInfo"](
        header, *size, "plumb_bob", np.zeros(5), K, np.eye(3).ravel(), np.zeros(12), 0, 0, roi
    )
    image = types["sensor_msgs/msg/Image"](header, *size, "16UC1", 0, 2 * CAMERA.width, pixels)
    with Writer(tmp_path / "bag", version=8, storage_plugin=StoragePlugin.MCAP) as bag:
        for topic, message in (("/c/depth/image", image), ("/c/depth/camera_info", info)):
            link = bag.add_connection(topic, message.__msgtype__, typestore=store)
            bag.write(link, 5 * 10**9, store.serialize_cdr(message, message.__msgtype__))
    look(host, tmp_path / "out", "camera=bag", f"camera.path={tmp_path}/bag")


@pytest.mark.skipif(not HAS_REALSENSE, reason="pip install 'pecgrasp[realsense]' and libusb-1.0")
def test_a_realsense_looks_through_its_own_library(host, tmp_path, monkeypatch):
    software = SoftwareRealSense(depth_of_box, CAMERA).run()
    monkeypatch.setattr(driver, "first_device", lambda: software.device)
    try:
        look(host, tmp_path / "out", "camera=realsense", "camera.resolution=424x240", "camera.frames=4")
    finally:
        software.close()


@pytest.mark.slow
@pytest.mark.skipif(not HAS_REALSENSE, reason="pip install 'pecgrasp[realsense]' and libusb-1.0")
def test_pictures_for_calibration_are_taken_while_the_arm_stands_and_give_the_cameras_place(
    host, tmp_path, monkeypatch, capsys
):
    """The arm of the stand-in goes where a hand would lead it; the software camera sees the board from there."""
    board, camera = Board(), intrinsics_of("848x480")
    T_base_board = np.eye(4)
    T_base_board[:3, :3] = np.diag([-1.0, 1.0, -1.0])  # face up
    T_base_board[:3, 3] = 0.6, -0.08, 0.0
    rng = np.random.default_rng(0)
    arm = URArm(host, patience=PATIENCE_S)
    spread = np.array([0.05, 0.08, 0.12, 0.35, 0.35, 0.6])
    middle = HOME + np.array([0.0, 0.0, 0.25, -0.25, 0.0, 0.0])
    postures = iter([middle + rng.uniform(-1, 1, 6) * spread for _ in range(20)])
    pictures = []

    def picture():
        return pictures[-1]

    def led_by_hand(words):
        q = next(postures, None)
        if q is None:
            return "q"
        arm.move_joints(q).wait(PATIENCE_S)
        T = np.linalg.inv(forward_kinematics(arm.state.q) @ T_TOOL0_CAMERA) @ T_base_board
        pictures.append(draw_board(board, T, camera, rng))
        return ""

    software = SoftwareRealSense(lambda: np.zeros((480, 848)), camera, infrared=picture)
    pictures.append(np.zeros((480, 848), np.uint8))
    software.run()
    monkeypatch.setattr(driver, "first_device", lambda: software.device)
    monkeypatch.setattr("builtins.input", led_by_hand)
    try:
        run("calibrate", "record", f"{tmp_path}/views", f"host={host}", f"output={tmp_path}/out")
    finally:
        software.close()
        arm.close()
    said = capsys.readouterr().out
    count = len(list((tmp_path / "views").glob("*.png")))
    assert count >= 10, said
    run("calibrate", f"{tmp_path}/views", f"output={tmp_path}/out")
    found = read_mount(tmp_path / "out" / "T_tool0_camera.yaml")
    assert np.linalg.norm(found[:3, 3] - T_TOOL0_CAMERA[:3, 3]) < 0.003
