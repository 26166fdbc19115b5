"""The environments as Gymnasium knows them."""

from __future__ import annotations

MAX_EPISODE_STEPS = 400


def register() -> None:
    """Register the environments by name: nothing heavy is imported before `gymnasium.make`."""
    import gymnasium
    from gymnasium.envs.registration import WrapperSpec

    # As ManiSkill's own `register_env` does, but by name, so that nothing heavy is imported before `make`.
    gymnasium.register(
        "SelectiveGrasp-v1",
        entry_point="pecgrasp_env.envs.selective_grasp:SelectiveGraspEnv",
        max_episode_steps=MAX_EPISODE_STEPS,
        disable_env_checker=True,  # batched tensors; `check_env` is for the unbatched form
        additional_wrappers=(
            WrapperSpec(
                "MSTimeLimit",
                "mani_skill.utils.registration:TimeLimitWrapper",
                {"max_episode_steps": MAX_EPISODE_STEPS},
            ),
        ),
    )
    gymnasium.register(
        "SelectiveGraspReal-v1",
        entry_point="pecgrasp_env.envs.real_robot:SelectiveGraspRealEnv",
        max_episode_steps=MAX_EPISODE_STEPS,
        nondeterministic=True,
    )
    gymnasium.register(
        "SelectiveGraspSingle-v1",
        entry_point="pecgrasp_env.envs.single:SelectiveGraspSingleEnv",
        max_episode_steps=MAX_EPISODE_STEPS,
    )
