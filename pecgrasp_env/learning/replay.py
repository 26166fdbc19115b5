"""ManiSkill's replay tool, which knows SelectiveGrasp-v1 then.

    python -m pecgrasp_env.learning.replay --traj-path FILE.h5

All its options (`--help`) hold. ``--target-control-mode`` takes demonstrations in joint positions or joint steps to any
control mode; ManiSkill's own conversion copies the gripper's action as it is, and metres are none of [-1, 1].
"""

from __future__ import annotations

import multiprocessing
from collections.abc import Sequence
from typing import Any

import numpy as np
from mani_skill.trajectory import replay_trajectory

from pecgrasp_env.learning.control_modes import from_joint_targets, to_joint_targets


def convert(
    output_mode: str,
    ori_actions: Sequence[np.ndarray],
    ori_env: Any,
    env: Any,
    render: bool = False,
    pbar: Any = None,
    verbose: bool = False,
) -> dict[str, Any]:
    """Plays actions of the control mode of ``ori_env`` in ``env``, which is in another; returns the last info.

    The arguments are those by which ManiSkill's tool calls its own conversions.
    """
    if pbar is not None:
        pbar.reset(total=len(ori_actions))
    info: dict[str, Any] = {}
    agent = env.unwrapped.agent
    for action in ori_actions:
        targets = to_joint_targets(agent, ori_env.unwrapped.control_mode, action)
        *_, info = env.step(from_joint_targets(agent, targets))
        if render:
            env.render_human()
        if pbar is not None:
            pbar.update()
    return info


# Processes that the tool starts import this module, too.
replay_trajectory.action_conversion.from_pd_joint_pos = convert
replay_trajectory.action_conversion.from_pd_joint_delta_pos = convert

if __name__ == "__main__":
    multiprocessing.set_start_method("spawn")  # the renderer does not survive a fork
    replay_trajectory.main(replay_trajectory.parse_args())
