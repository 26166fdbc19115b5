"""The `tabletop` scenario, what the robot sees: objects at rest on its table, looked at from the policy's postures, and
cut out of the frame by the segmentation that runs on the robot.

A frame shows several objects, laid out as the task SelectiveGrasp-v1 lays them out: as they come to rest after a fall
in a random orientation, turned about the vertical, anywhere in the task's region, apart. The wrist camera looks from
one of the postures from which the policy looks; with `free_views` a camera on a stand takes a share of the frames, from
near or far, high up or low down. The table and the floor are planes, so their depth is computed, not
drawn; the gripper is out of the camera's view. The sensor sees all of it at once, and `grasping.Segmenter` finds the
objects, with whatever it loses or adds. Which object a cut-out is, the renderer says: it is labelled by the object that
most of its points lie on, and thrown away where others have too large a share of it. The dissertation has no such set.

Draws that are not kept, by reason: "out of view" (cut off by the image's border), "hidden" (more than `max_occlusion`
of it), "not found" (no cut-out of it), "mixed" (`purity` below `min_purity`), "too few points", "fragment" (a further,
smaller cut-out of the same object), "nothing" (a cut-out of no object), "no room" (a layout that did not fit).
"""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import Rotation

from grasping import ROBOTIQ_2F_140, CloudError, Scene, Segmenter
from pec.data.shards import CloudSample
from pecgrasp_env.capture.config import CaptureConfig, CaptureError
from pecgrasp_env.capture.rendering.depth_renderer import DepthRenderer, Renderer, Shot
from pecgrasp_env.capture.rendering.tabletop_depth import Table, compose
from pecgrasp_env.capture.rendering.view_of_table import draw_view
from pecgrasp_env.capture.scenarios.base import Captured, Subject, rotation_matrix, sample_seed
from pecgrasp_env.capture.scenarios.measured_table import measured_table
from pecgrasp_env.objects import CLASSES, ObjectModel, make_object
from pecgrasp_env.policy.observation import DepthFrame, RobotObservation
from pecgrasp_env.policy.perception import segment_frame
from pecgrasp_env.policy.viewpoints import look_postures
from pecgrasp_env.robot import T_TOOL0_CAMERA, forward_kinematics
from pecgrasp_env.scene.placement import REGION, PlacementError, arrange
from pecgrasp_env.scene.settling import drop
from pecgrasp_env.sensor.intrinsics import deproject

if TYPE_CHECKING:
    from pecgrasp_env.sensor import CameraIntrinsics

__all__ = ["MOST_FRAMES", "CutOut", "Layout", "TabletopScenario", "cut_outs", "resting_poses", "segment_layout"]

MOST_FRAMES = 200
"""Frames in a row without a sample of an object before it is given up: the policy's camera sees it in nearly each."""
_LARGEST = 0.45
"""m; the segmenter calls nothing larger an object."""
_STAND_NEAREST = 0.45
"""m of a camera on a stand from what it looks at."""


def resting_poses(model: ObjectModel, drops: int, seed: int) -> np.ndarray:
    """Poses (k, 7), position m and quaternion wxyz, in which an object rests on the plane z = 0, as often as it falls
    into each of them.

    `drops` orientations, uniform on SO(3), fall side by side in one physics scene; those still in motion at the end are
    left out. x and y are 0. Raises CaptureError where none comes to rest.
    """
    rng = np.random.default_rng(sample_seed(seed, model.class_name, model.instance, -1 % 2**32))
    quaternions = rng.standard_normal((drops, 4))  # w, x, y, z; SciPy wants w last
    ends, at_rest = drop([model] * drops, Rotation.from_quat(np.roll(quaternions, -1, axis=1)))
    if not at_rest.any():
        raise CaptureError(f"none of {drops} drops came to rest on the table")
    poses = ends[at_rest]
    poses[:, :2] = 0
    return poses


@dataclass(frozen=True)
class Layout:
    """A laid table before anybody has looked at it; without shots where the objects did not fit on it."""

    seed: int
    rng: np.random.Generator
    """Goes on to draw the sensor's faults."""
    number: int
    """Of the camera, among the configuration's."""
    camera: CameraIntrinsics
    q: np.ndarray
    """Joint angles (6,), rad."""
    T_base_camera: np.ndarray
    on_stand: bool
    """Not the robot's camera, which therefore is nowhere in sight."""
    shots: list[Shot]


@dataclass(frozen=True)
class CutOut:
    """What the segmenter took for one object. points: (N, 3), m, camera frame.

    owner: the object's place in the layout that most of its points on objects lie on, None where there are none.
    purity: that one's share of those points. overlap: points on it, of the union with all that is seen of it.
    """

    points: np.ndarray
    at_border: bool
    owner: int | None
    purity: float
    overlap: float


def segment_layout(layout: Layout, depth: np.ndarray, segmenter: Segmenter) -> Scene | None:
    """What is seen in a layout's depth (H, W), m; None where nothing is."""
    try:
        if layout.on_stand:
            return segmenter.segment(deproject(depth, layout.camera), up=layout.T_base_camera[2, :3])
        frame = DepthFrame(depth, layout.camera)
        return segment_frame(RobotObservation(layout.q, ROBOTIQ_2F_140.stroke, lambda: frame), segmenter)
    except CloudError:
        return None


def cut_outs(scene: Scene | None, measured: Table, pairs: bool = False) -> list[CutOut]:
    """The objects of a scene, the largest first, and whose they are; with pairs, behind them those that adjoin, as one.

    measured: the table that was cut, with its depth as it was measured.
    """
    if scene is None:
        return []
    owner = np.where(measured.depth > 0, measured.owner, 0).reshape(-1)
    seen = np.bincount(owner, minlength=len(measured.occlusion) + 1)[1:]

    def cut_out(*numbers: int) -> CutOut:
        points, indices = (np.concatenate([of[i] for i in numbers]) for of in (scene.objects, scene.indices))
        shares = np.bincount(owner[indices], minlength=len(seen) + 1)[1:]
        most = int(shares.argmax())
        purity, overlap = shares[most] / max(shares.sum(), 1), shares[most] / (len(indices) + seen[most] - shares[most])
        at_border = any(scene.touches_border[i] for i in numbers)
        return CutOut(points, at_border, most if shares[most] else None, float(purity), float(overlap))

    found = [cut_out(i) for i in range(len(scene.objects))]
    return found + [cut_out(cut.first, cut.second) for cut in scene.cuts] if pairs else found


class TabletopScenario:
    """Several objects at a time on the robot's table, under its wrist camera."""

    def __init__(self, config: CaptureConfig, open_renderer: Callable[[float], Renderer] = DepthRenderer) -> None:
        self._config = config
        self._renderer = open_renderer(_LARGEST)
        self._segmenter = Segmenter()
        self._postures = look_postures()
        self._resting: dict[tuple[str, str], np.ndarray] = {}

    def capture(self, subjects: Sequence[Subject], first: int, count: int) -> Captured[CloudSample]:
        captured = Captured[CloudSample]()
        kept: list[Subject] = []
        for subject in subjects:
            try:
                self._check(subject.model)
                kept.append(subject)
            except CaptureError as error:
                captured.given_up[subject.name] = str(error)
        if not kept:
            return captured
        # Frames are drawn from the names of those in the group and from the place of its samples in the data set.
        key = "/".join(f"{s.model.class_name}:{s.model.instance}" for s in kept)
        models = [subject.model for subject in kept]
        models += self._distractors(np.random.default_rng(sample_seed(self._config.seed, "distractors", key, first)))
        self._renderer.show(models)
        found: list[list[CloudSample]] = [[] for _ in kept]
        barren = np.zeros(len(kept), int)
        reasons: list[Counter[str]] = [Counter() for _ in kept]
        frames = self._frames(models, f"frames from {first}", key)
        while wanted := [i for i in range(len(kept)) if len(found[i]) < count and barren[i] < MOST_FRAMES]:
            samples = self._cut(*next(frames), kept, {i: reasons[i] for i in wanted}, captured.rejected)
            for i in wanted:
                barren[i] = 0 if i in samples else barren[i] + 1
                if i in samples:
                    found[i].append(samples[i])
        for i, subject in enumerate(kept):
            if len(found[i]) == count:
                captured.samples += found[i]
                captured.rejected += reasons[i]
            else:
                why = ", ".join(f"{reason}: {n}" for reason, n in reasons[i].most_common())
                captured.given_up[subject.name] = (
                    f"{MOST_FRAMES} frames in a row gave no cloud of it ({why}); a smaller min_points or a larger "
                    "max_occlusion may help; what is below 2 mm or above 0.45 m is no object to the segmenter"
                )
        return captured

    def _frames(self, models: Sequence[ObjectModel], first: str, key: str) -> Iterator[tuple[Layout, Table | None]]:
        """Laid tables and what an exact camera sees of them, None where there was no room; without end."""
        ahead = max(1, self._renderer.at_once // len(models))
        for start in itertools.count(0, ahead):
            layouts = [
                self._lay_out(models, sample_seed(self._config.seed, first, key, number))
                for number in range(start, start + ahead)
            ]
            frames = iter(self._renderer.render_all([shot for layout in layouts for shot in layout.shots]))
            for layout in layouts:
                of_layout = list(itertools.islice(frames, len(layout.shots)))
                table = compose(layout.shots, of_layout, layout.T_base_camera, layout.camera) if of_layout else None
                yield layout, table

    def _lay_out(self, models: Sequence[ObjectModel], seed: int) -> Layout:
        config, rng = self._config, np.random.default_rng(seed)
        of_robot = len(config.intrinsics) * len(self._postures)
        number = int(rng.integers(of_robot))
        resolution, posture = divmod(number, len(self._postures))
        camera = config.intrinsics[resolution]
        q = self._postures[posture] + rng.uniform(-1, 1, 6) * config.tabletop.joint_noise
        T_base_camera = forward_kinematics(q) @ T_TOOL0_CAMERA
        on_stand = config.tabletop.free_views > 0 and rng.uniform() < config.tabletop.free_views
        if on_stand:
            number = of_robot + resolution
            x, y = rng.uniform(REGION.x_min, REGION.x_max), rng.uniform(REGION.y_min, REGION.y_max)
            target = np.array([x, y, 0.0])
            T_base_camera = draw_view(target, (-np.pi, np.pi), _STAND_NEAREST, rng)
        try:
            placed = self._place(models, rng)
        except PlacementError:
            return Layout(seed, rng, number, camera, q, T_base_camera, on_stand, [])
        T_camera_base = np.linalg.inv(T_base_camera)
        poses = [T_camera_base @ _matrix(pose) for pose in placed]
        shots = [Shot(i, pose, camera, self._renderer.extent(i, pose, camera)) for i, pose in enumerate(poses)]
        return Layout(seed, rng, number, camera, q, T_base_camera, on_stand, shots)

    def _check(self, model: ObjectModel) -> None:
        """Raises CaptureError where an object cannot be captured."""
        self._renderer.check(model)
        self._rest(model)

    def _place(self, models: Sequence[ObjectModel], rng: np.random.Generator) -> np.ndarray:
        """Where the objects lie (n, 7), the robot's frame. Raises PlacementError where they do not find room."""
        drawn = np.stack([poses[rng.integers(len(poses))] for poses in map(self._rest, models)])
        return arrange(models, drawn, rng, REGION, self._config.tabletop.clearance)

    def _cut(
        self,
        layout: Layout,
        table: Table | None,
        subjects: Sequence[Subject],
        reasons: Mapping[int, Counter[str]],
        rejected: Counter[str],
    ) -> dict[int, CloudSample]:
        """One frame's samples of the subjects that `reasons` counts for; it counts why one of them gave none."""
        samples: dict[int, CloudSample] = {}
        if table is None:
            for counter in reasons.values():
                counter["no room"] += 1
            return samples
        measured = measured_table(self._config, table, layout.camera, layout.rng)
        best = self._best(layout, measured, subjects, rejected)
        for i, counter in reasons.items():
            occlusion, of_subject = float(table.occlusion[i]), (subjects[i].class_index, subjects[i].instance_index)
            reason = self._reason(occlusion, best.get(i))
            if reason is not None:
                counter[reason] += 1
                continue
            points, purity = best[i].points, best[i].purity
            pose = layout.shots[i].T_camera_object
            samples[i] = CloudSample(points, *of_subject, pose, layout.seed, layout.number, occlusion, purity)
        return samples

    def _best(
        self, layout: Layout, measured: Table, subjects: Sequence[Subject], rejected: Counter[str]
    ) -> dict[int, CutOut]:
        """The largest cut-out of each object of a table as it was measured, by its place in the layout."""
        best: dict[int, CutOut] = {}
        for cut in cut_outs(segment_layout(layout, measured.depth, self._segmenter), measured):
            if cut.owner is None:
                rejected["nothing"] += 1
            elif cut.owner in best:
                rejected["fragment"] += 1  # the largest comes first
            else:
                best[cut.owner] = cut
        return best

    def _reason(self, occlusion: float, cut: CutOut | None) -> str | None:
        """Why a subject gives no sample, or None where it gives one."""
        if np.isnan(occlusion) or (cut is not None and cut.at_border):
            return "out of view"
        if occlusion > self._config.max_occlusion:
            return "hidden"
        if cut is None:
            return "not found"
        if cut.owner is not None and cut.purity < self._config.tabletop.min_purity:
            return "mixed"
        if len(cut.points) < self._config.min_points:
            return "too few points"
        return None

    def _rest(self, model: ObjectModel) -> np.ndarray:
        key = model.class_name, model.instance
        if key not in self._resting:
            self._resting[key] = resting_poses(model, self._config.tabletop.drops, self._config.seed)
        return self._resting[key]

    def _distractors(self, rng: np.random.Generator) -> list[ObjectModel]:
        """Objects of the catalogue of no class of the data set."""
        others = [name for name in CLASSES if name not in self._config.labelled_classes]
        if self._config.tabletop.distractors and not others:
            raise CaptureError("tabletop.distractors: the data set labels all classes of the catalogue, none is left")
        return [
            make_object(others[rng.integers(len(others))], int(rng.integers(1000, 2000)))
            for _ in range(self._config.tabletop.distractors)
        ]


def _matrix(pose: np.ndarray) -> np.ndarray:
    """(4, 4) of a pose (7,)."""
    T = np.eye(4)
    T[:3, :3] = rotation_matrix(pose[3:])
    T[:3, 3] = pose[:3]
    return T
