"""Pictures of failures: the grasp where the camera sees it, and all three kinds out of an episode that failed."""

import numpy as np
import pytest
from PIL import Image

from grasping import CurvaturePlanner, Grasp, GraspPlan
from pecgrasp_env.evaluation.failure_images import FailureImages, camera, observed_image
from pecgrasp_env.evaluation.recording_policy import Sight
from pecgrasp_env.evaluation.run import Protocol
from pecgrasp_env.policy.observation import DepthFrame, RobotObservation
from pecgrasp_env.policy.seen_objects import SeenObject
from pecgrasp_env.robot.kinematics import HOME
from pecgrasp_env.sensor import CameraIntrinsics


def test_the_planned_grasp_is_drawn_where_the_camera_sees_it():
    picture = DepthFrame(np.full((240, 424), 0.6, np.float32), CameraIntrinsics(424, 240, 306.0, 306.0, 212.0, 120.0))
    observation = RobotObservation(np.array(HOME), 0.14, lambda: picture)
    T = observation.T_base_camera
    ahead = T[:3, :3] @ np.array([0.05, 0.0, 0.55]) + T[:3, 3]
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = T[:3, :3], ahead  # closes along the picture's rows, comes in along the optical axis
    grasp = Grasp(pose, 0.06, 1.0, "region")
    bare = observed_image(Sight(observation, [SeenObject(ahead[None], False)]))
    assert not (bare == (255, 70, 60)).all(axis=2).any()
    drawn = observed_image(Sight(observation, [SeenObject(ahead[None], False)], 0, GraspPlan(grasp, [grasp], [], None)))
    assert bare.shape == drawn.shape == (240, 424, 3)
    rows, columns = np.nonzero((drawn == (255, 70, 60)).all(axis=2))
    told = observed_image(Sight(observation, [SeenObject(ahead[None], False, [{"mouse": 0.9, "can": 0.1}])]))
    assert (told != bare).any()  # its class stands there
    # The picture is cut out about the point, twice as large; what is nearer, the hand, looks larger than the pads.
    assert rows.mean() == pytest.approx(120, abs=4)
    assert columns.mean() == pytest.approx(212, abs=8)
    assert 0.8 < np.ptp(columns) / (2 * 306 * 0.06 / 0.55) < 1.5


def test_pictures_of_a_failure_are_kept(tmp_path):
    """A planner that grasps the air: the hand closes on nothing, and three pictures say so. So they do of a lift."""

    class Above(CurvaturePlanner):
        def plan(self, points, **scene):
            return super().plan(points + np.array([0.0, 0.0, 0.12]), **scene | {"obstacles": None, "table": None})

    scene = {"n_objects": 1, "classes": ["plug_adapter"], "sensor": "d435", "objects": {"seed": 1000}}
    protocol = Protocol(scene, None, {"_target_": "grasping.CurvaturePlanner"}, {"attempts": 1})
    env = protocol.make_env(render_mode="rgb_array", human_render_camera_configs=camera())
    policy = protocol.make_policy()
    for seed, planner in ((5, Above()), (6, CurvaturePlanner())):
        policy.planner = planner
        watch = FailureImages(env, policy)
        obs, info = env.reset(seed=seed)
        watch.policy.reset(info["target"][0])
        while not watch.policy.done:
            obs, *_ = env.step(watch.policy.act(obs))
            watch.on_step(env)
        assert policy.log.lifted == (seed == 6)
        watch.save(tmp_path, seed)
    env.close()
    names = [f"{seed}.{kind}.webp" for seed in (5, 6) for kind in ("camera", "end", "try")]
    assert sorted(path.name for path in tmp_path.iterdir()) == names
    for path in tmp_path.iterdir():
        with Image.open(path) as image:
            assert image.width == 424
            assert np.asarray(image).std() > 10
