"""The program that the library `ur_rtde` sends to the controller, as far as its commands are understood here.

The client writes what it wants into the input registers: integer 0 is the command, floats its arguments. The program
answers in output register integer 0: 1, ready for a command; 2, done with it. A command is carried out once; the
client takes it back (0) before the next. Real-time commands, such as `servoj`, are carried out in every period.
"""

from __future__ import annotations

import re

import numpy as np
from scipy.spatial.transform import Rotation

from pecgrasp_env.motion.joint_path import MotionError, straight_line
from pecgrasp_env.real.fakes.controller import T_CONTROLLER_BASE, Controller, Program, matrix_of
from pecgrasp_env.real.fakes.motions import at_rates
from pecgrasp_env.robot.kinematics import forward_kinematics, nearest_solution

READY, DONE = 1, 2
MOVE_J, MOVE_J_IK, MOVE_L, MOVE_L_FK = 1, 2, 3, 4
SPEED_J, SERVO_J, SPEED_STOP, SERVO_STOP = 9, 11, 15, 16
SET_PAYLOAD, STEP_TIME, SET_TCP, INVERSE, PROTECTIVE_STOP, STOP_L, STOP_J = 17, 26, 29, 30, 31, 33, 34
SET_WATCHDOG, JOINTS_SAFE, TCP_OFFSET, FORWARD, FORWARD_OF, MOVE_PATH = 35, 37, 40, 43, 44, 45
INVERSE_DEFAULT, IS_STEADY, STOP_SCRIPT = 46, 47, 255
_EVERY_PERIOD = {6, SPEED_J, 10, SERVO_J, 24, 25, STEP_TIME, 27, 38}
_STEADY_RAD_S = 0.01
_PATH_LINE = re.compile(r"movej\(\[([^\]]+)\],\s*a=([-\d.e]+),\s*v=([-\d.e]+)")
_RUNS, _WRITTEN, _OPERATION = 1 << 15, 1 << 16, 1 << 24  # fields of the register that tells of what runs on


class ControlScript(Program):
    """`ur_rtde`'s program with what it was sent with: a path between its lines, and an offset of its registers."""

    def __init__(self, text: str, controller: Controller) -> None:
        self._controller = controller
        self._offset = 24 if "# int register offset\n24" in text else 0
        lines = [match for match in map(_PATH_LINE.search, text.splitlines()) if match is not None]
        self._path = np.array([[float(number) for number in match[1].split(",")] for match in lines]).reshape(-1, 6)
        self._path_speed = min((float(match[3]) for match in lines), default=1.0)
        self._path_acceleration = min((float(match[2]) for match in lines), default=1.0)
        self._executed = False  # the command that still stands in the register
        self._waits, self._runs_on = False, False  # for a motion that was asked for; one that goes on by itself
        self._written, self._operation = 0, 0
        self._async(False)
        self._say(READY)

    def step(self) -> bool:
        controller = self._controller
        command = controller.integers_in[self._offset]
        if self._runs_on and not controller.moving:
            self._runs_on = False
            self._async(False)
        if self._waits:
            if not controller.moving:
                self._waits = False
                self._say(DONE)
            return True
        if command in _EVERY_PERIOD:
            self._carry_out(command)
            self._say(READY)
        elif command == 0:
            self._executed = False
            self._say(READY)
        elif not self._executed:
            self._executed = True
            if command == STOP_SCRIPT:
                return False
            self._waits = self._carry_out(command)
            if not self._waits:
                self._say(DONE)
        return True

    def _say(self, state: int) -> None:
        self._controller.integers_out[self._offset] = state

    def _async(self, begins: bool) -> None:
        self._written = (self._written + 1) % 128
        self._operation = (self._operation + begins) % 128
        told = self._written * _WRITTEN + self._operation * _OPERATION + begins * _RUNS
        self._controller.integers_out[2 + self._offset] = told

    def _floats(self, first: int, count: int) -> np.ndarray:
        first += self._offset
        return np.array(self._controller.doubles_in[first : first + count])

    def _tell(self, values: np.ndarray) -> None:
        for k, value in enumerate(values):
            self._controller.doubles_out[self._offset + k] = float(value)

    def _carry_out(self, command: int) -> bool:
        """Do it; whether the program waits for the motion that it begins."""
        controller = self._controller
        six, more = self._floats(0, 6), self._floats(6, 8)
        if command in (MOVE_J, MOVE_J_IK, MOVE_L, MOVE_L_FK, MOVE_PATH):
            return self._move(command, six, float(more[0]), float(more[1]))
        if command == SERVO_J:
            controller.servo(six, float(more[3]))
        elif command == SPEED_J:
            controller.run(at_rates(controller.target, controller.rates, six, float(more[0]), controller.period))
        elif command in (SPEED_STOP, SERVO_STOP, STOP_L, STOP_J):
            if self._runs_on:
                self._runs_on = False
                self._async(False)
            controller.slow_down(max(float(six[0]), 0.1))
            return True
        elif command == SET_PAYLOAD:
            controller.payload = (float(six[0]), six[1:4])
        elif command == SET_TCP:
            controller.tcp = six
        elif command == STEP_TIME:
            self._tell(np.array([controller.period]))
        elif command == PROTECTIVE_STOP:
            controller.protective_stop()
        elif command == SET_WATCHDOG:
            controller.set_watchdog(float(six[0]))
        elif command == JOINTS_SAFE:
            low, high = controller.plant.arm.limits.T
            safe = bool(((six >= low) & (six <= high)).all())
            controller.integers_out[1 + self._offset] = int(safe)
        elif command == TCP_OFFSET:
            self._tell(controller.tcp)
        elif command == FORWARD:
            self._tell(controller.tool_pose(controller.measured))
        elif command == FORWARD_OF:
            T = T_CONTROLLER_BASE @ forward_kinematics(six, controller.plant.arm) @ matrix_of(more[:6])
            self._tell(np.concatenate([T[:3, 3], Rotation.from_matrix(T[:3, :3]).as_rotvec()]))
        elif command in (INVERSE, INVERSE_DEFAULT):
            q = self._inverse(six)
            if q is None:
                controller.stop_program()
            else:
                self._tell(q)
        elif command == IS_STEADY:
            controller.integers_out[1 + self._offset] = int(np.abs(controller.measured_rates).max() < _STEADY_RAD_S)
        return False

    def _move(self, command: int, six: np.ndarray, speed: float, acceleration: float) -> bool:
        controller = self._controller
        path: np.ndarray | None = six[None]
        try:
            if command == MOVE_J_IK:
                q = self._inverse(six)
                path = None if q is None else q[None]
            elif command in (MOVE_L, MOVE_L_FK):
                arm = controller.plant.arm
                start = forward_kinematics(controller.target, arm)
                end = _T_base_tool0(six, controller.tcp) if command == MOVE_L else forward_kinematics(six, arm)
                path = straight_line(controller.target, start, end, arm)[1:]
                # The line's length is what its speed is of.
                length = float(np.linalg.norm(end[:3, 3] - start[:3, 3]))
                turned = float(np.abs(np.diff(path, axis=0)).max(axis=1).sum())
                ratio = turned / max(length, 1e-6) if length > 1e-6 else 1.0
                speed, acceleration = speed * ratio, acceleration * ratio
            elif command == MOVE_PATH:
                path, speed, acceleration = self._path, self._path_speed, self._path_acceleration
        except MotionError:
            path = None
        if path is None or len(path) == 0:  # the controller's own arithmetic fails, and the program with it
            controller.stop_program()
            return False
        controller.move(path, speed, acceleration)
        if controller.integers_in[1 + self._offset]:
            self._runs_on = True
            self._async(True)
            return False
        return True

    def _inverse(self, pose: np.ndarray) -> np.ndarray | None:
        controller = self._controller
        return nearest_solution(_T_base_tool0(pose, controller.tcp), controller.target, controller.plant.arm)


def _T_base_tool0(pose: np.ndarray, tcp: np.ndarray) -> np.ndarray:
    """Of the flange in our base frame, from a tool centre point's pose in the controller's."""
    return np.asarray(T_CONTROLLER_BASE @ matrix_of(pose) @ np.linalg.inv(matrix_of(tcp)))
