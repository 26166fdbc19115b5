"""The environments as Gymnasium knows them."""

from __future__ import annotations

MAX_EPISODE_STEPS = 400


def register() -> None:
    """Register the environments by name: nothing heavy is imported before `gymnasium.make`."""
    import gymnasium
    from gymnasium.envs.registration import WrapperSpec

    # As ManiSkill's own `register_env` does, but by name, so that nothing heavy is imported before `make`.
    for name, entry_point in (
        ("SelectiveGrasp-v1", "pecgrasp_env.envs.selective_grasp:SelectiveGraspEnv"),
        ("DualGrasp-v1", "pecgrasp_env.envs.dual.dual_grasp:DualGraspEnv"),
    ):
        gymnasium.register(
            name,
            entry_point=entry_point,
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
    for name, entry_point in (
        ("SelectiveGraspSingle-v1", "pecgrasp_env.envs.single:SelectiveGraspSingleEnv"),
        ("DualGraspSingle-v1", "pecgrasp_env.envs.dual.single:DualGraspSingleEnv"),
    ):
        gymnasium.register(name, entry_point=entry_point, max_episode_steps=MAX_EPISODE_STEPS)
