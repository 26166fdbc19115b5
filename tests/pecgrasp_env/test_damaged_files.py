"""Files that a crash or a bad disk has spoilt: each reader says which, by an error of its own, whatever is wrong."""

import numpy as np
import pytest

from grasping.errors import ConfigError
from grasping.segmentation.boosted_trees import read_relations
from grasping.segmentation.trained import NAMES, TRAINED
from pec.errors import DatasetError
from pecgrasp_env.capture.scenes.frames import LabelledFrame, read_frames, write_frames
from pecgrasp_env.experiments.known_poses.cases import real_views
from pecgrasp_env.policy.observation import DepthFrame, RobotObservation
from pecgrasp_env.real.camera.recorded import read_depth_image, write_depth_image
from pecgrasp_env.real.connected import SettingError
from pecgrasp_env.real.errors import RobotError
from pecgrasp_env.real.interfaces import DepthImage
from pecgrasp_env.real.learning import CLOUDS, read_clouds, write_clouds
from pecgrasp_env.real.pick_record import RecordError, recorded_frames, write_frame
from pecgrasp_env.robot.kinematics import HOME
from pecgrasp_env.sensor.intrinsics import intrinsics_of

CAMERA = intrinsics_of("424x240")
DEPTH = np.random.default_rng(0).uniform(0.4, 0.8, (CAMERA.height, CAMERA.width)).astype(np.float32)


def frames_file(folder):
    one = np.zeros(1)
    frame = LabelledFrame(
        DEPTH, np.zeros(DEPTH.shape, np.uint8), CAMERA.matrix, np.eye(4), 0, 0, 0, 0, False, one, np.zeros((1, 7)), one
    )
    (folder / "shards").mkdir()
    write_frames(folder / "shards" / "000.npz", [frame])
    return folder / "shards" / "000.npz"


def recorded_file(folder):
    (folder / "frames").mkdir()
    frame = DepthFrame(DEPTH, CAMERA)
    write_frame(folder / "frames" / "000.npz", RobotObservation(HOME, 0.14, lambda: frame, camera=np.eye(4)), frame)
    return folder / "frames" / "000.npz"


def image_file(folder):
    write_depth_image(folder / "image.npz", DepthImage(DEPTH, CAMERA, 0.0))
    return folder / "image.npz"


def clouds_file(folder):
    write_clouds(folder, [DEPTH[:100, :3], DEPTH[100:200, :3]])
    return folder / CLOUDS


def views_file(folder):
    file = folder / "views.npz"
    corners, faces = (
        np.array([[0.0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [0, 0, 0.1]]),
        [(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)],
    )
    np.savez_compressed(
        file, depth=(DEPTH[None] * 1000).astype(np.uint16), depth_scale_m=0.001, K=CAMERA.matrix,
        T_camera_object=np.eye(4)[None], mesh_vertices=corners, mesh_faces=faces,
    )  # fmt: skip
    return file


def trees_file(folder):
    (folder / "relations.npz").write_bytes(TRAINED.read_bytes())
    return folder / "relations.npz"


READERS = {
    "frames": (frames_file, lambda file: list(read_frames(file)), DatasetError),
    "a pick": (recorded_file, lambda file: list(recorded_frames(file.parent.parent)), RecordError),
    "an image": (image_file, read_depth_image, RobotError),
    "taught clouds": (clouds_file, lambda file: read_clouds(file.parent), SettingError),
    "views": (views_file, lambda file: list(real_views(file)), DatasetError),
    "trees": (trees_file, lambda file: read_relations(file, NAMES), ConfigError),
}


@pytest.mark.parametrize("kind", READERS)
def test_a_spoilt_file_is_named(kind, tmp_path):
    make, read, error = READERS[kind]
    file = make(tmp_path)
    read(file)
    whole, rng = file.read_bytes(), np.random.default_rng(1)
    spoilt = [b"", b"PK", whole[: len(whole) // 2], whole[:-30], b"\x00" * len(whole)]
    for _ in range(12):  # a sector overwritten
        at = int(rng.integers(len(whole) - 512)) if len(whole) > 512 else 0
        spoilt.append(whole[:at] + rng.bytes(512) + whole[at + 512 :])
    for content in spoilt:
        file.write_bytes(content)
        with pytest.raises(error, match=file.name):
            read(file)
