"""Ways to find one known object in a cut-out: ours, and two that others use, where they are installed."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from importlib.util import find_spec
from typing import Any, Protocol

import numpy as np

from grasping.pose.object_model import ObjectModel
from grasping.pose.pose_estimator import PoseEstimator

METHODS = ("geometry", "opencv_ppf", "open3d_fpfh")
_NEEDS = {"opencv_ppf": "cv2.ppf_match_3d", "open3d_fpfh": "open3d"}


class Method(Protocol):
    """Finds the pose of a model that is prepared once."""

    def __call__(self, points: np.ndarray) -> np.ndarray | None:
        """T_camera_object (4, 4) in a cloud (N, 3) m in the camera's frame; None: no pose."""


def method(name: str, model: ObjectModel) -> Method:
    """A method, prepared for a model. Raises ImportError where it is not installed, KeyError for an unknown one."""
    return _MAKE[name](model)


def installed(name: str) -> bool:
    """Whether what the method needs is there."""
    try:
        return name not in _NEEDS or find_spec(_NEEDS[name]) is not None
    except ImportError:
        return False


def _geometry(model: ObjectModel) -> Method:
    estimator = PoseEstimator([model])

    def find(points: np.ndarray) -> np.ndarray | None:
        poses = estimator.estimate(points)
        return poses[0].T_camera_object if poses else None

    return find


def _opencv(model: ObjectModel) -> Method:
    """Drost's features as opencv_contrib has them, with its sample's steps, its normals and its ICP."""
    cv2: Any = import_module("cv2")  # whose stubs do not know its contributed modules

    matcher = cv2.ppf_match_3d_PPF3DDetector(0.025, 0.05)
    template = np.hstack([model.points, model.normals]).astype(np.float32)
    matcher.trainModel(template)
    icp = cv2.ppf_match_3d_ICP(100)

    def find(points: np.ndarray) -> np.ndarray | None:
        _, scene = cv2.ppf_match_3d.computeNormalsPC3d(points.astype(np.float32), 12, True, (0.0, 0.0, 0.0))
        try:
            poses = matcher.match(scene, 1.0 / 5.0, 0.03)[:5]
            if not poses:
                return None
            icp.registerModelToScene(template, scene, poses)
        except cv2.error:
            return None
        best = np.asarray(min(poses, key=lambda pose: pose.residual).pose, np.float64)
        u, _, vt = np.linalg.svd(best[:3, :3])  # its poses are not orthonormal
        best[:3, :3] = u @ np.diag([1, 1, np.linalg.det(u @ vt)]) @ vt
        return best

    return find


def _open3d(model: ObjectModel) -> Method:
    """FPFH features, RANSAC and point-to-plane ICP, with the parameters of Open3D's tutorial for this size."""
    import open3d as o3d

    registration = o3d.pipelines.registration
    voxel = model.diameter / 25

    def prepared(points: np.ndarray, normals: np.ndarray | None) -> tuple[Any, Any]:
        cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points))
        if normals is not None:
            cloud.normals = o3d.utility.Vector3dVector(normals)
        cloud = cloud.voxel_down_sample(voxel)
        if normals is None:
            cloud.estimate_normals(o3d.geometry.KDTreeSearchParamHybrid(2 * voxel, 30))
            cloud.orient_normals_towards_camera_location(np.zeros(3))
        feature = registration.compute_fpfh_feature(cloud, o3d.geometry.KDTreeSearchParamHybrid(5 * voxel, 100))
        return cloud, feature

    template, template_features = prepared(model.points, model.normals)
    o3d.utility.random.seed(0)

    def find(points: np.ndarray) -> np.ndarray | None:
        scene, features = prepared(points, None)
        if len(scene.points) < 10:
            return None
        found = registration.registration_ransac_based_on_feature_matching(
            scene,
            template,
            features,
            template_features,
            True,
            1.5 * voxel,
            registration.TransformationEstimationPointToPoint(False),
            3,
            [
                registration.CorrespondenceCheckerBasedOnEdgeLength(0.9),
                registration.CorrespondenceCheckerBasedOnDistance(1.5 * voxel),
            ],
            registration.RANSACConvergenceCriteria(100_000, 0.999),
        )
        if not len(found.correspondence_set):
            return None
        fine = registration.registration_icp(
            scene,
            template,
            1.5 * voxel,
            found.transformation,
            registration.TransformationEstimationPointToPlane(),
        )
        return np.linalg.inv(fine.transformation)

    return find


_MAKE: dict[str, Callable[[ObjectModel], Method]] = {
    "geometry": _geometry,
    "opencv_ppf": _opencv,
    "open3d_fpfh": _open3d,
}
