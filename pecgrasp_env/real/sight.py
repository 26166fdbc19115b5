"""What arm, gripper and camera say at one moment, as the policy takes it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from pecgrasp_env.policy.observation import DepthFrame, RobotObservation
from pecgrasp_env.real.interfaces import Arm, DepthCamera, ParallelGripper
from pecgrasp_env.robot.camera_mount import BRACKET, CameraMount
from pecgrasp_env.robot.gripper_linkage import STROKE


class Sight:
    """Observations of a robot of one's own.

    Args:
        mount: where the camera is, from a hand-eye calibration.
        seen: called with each frame that is taken and what it belongs to.
    """

    def __init__(
        self,
        arm: Arm,
        gripper: ParallelGripper,
        camera: DepthCamera,
        mount: CameraMount = BRACKET,
        seen: Callable[[RobotObservation, DepthFrame], None] = lambda observation, frame: None,
    ) -> None:
        self._arm, self._gripper, self._camera = arm, gripper, camera
        self._mount, self._seen = mount, seen

    def observe(self) -> RobotObservation:
        """This moment; the frame is taken when it is looked at.

        What takes the frame does not hold the observation, which would live on with it until Python looks for cycles.
        """
        q = self._arm.state.q
        opening = float(np.clip(self._gripper.width, 0.0, STROKE))
        arm = self._arm.lengths
        camera = self._mount.T_base_camera(q, arm)

        def take() -> DepthFrame:
            image = self._camera.grab()
            frame = DepthFrame(image.depth, image.intrinsics)
            self._seen(RobotObservation(q, opening, lambda: frame, camera=camera, arm=arm), frame)
            return frame

        return RobotObservation(q, opening, take, camera=camera, arm=arm)
