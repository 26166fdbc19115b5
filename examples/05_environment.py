"""The task as a plain Gymnasium environment: reset, step, and what comes back.

    python examples/05_environment.py

`SelectiveGraspSingle-v1` is NumPy and unbatched; `SelectiveGrasp-v1` is the same task batched, as ManiSkill's are.
"""

import gymnasium as gym

import pecgrasp_env  # noqa: F401  registers the environments

env = gym.make("SelectiveGraspSingle-v1", obs_mode="state_dict", control_mode="pd_ee_delta_pose", n_objects=3)
obs, info = env.reset(seed=0)
print(f"asked for: {info['target']}, one-hot {obs['extra']['target']}")
print(f"actions: {env.action_space}")

total = 0.0
env.action_space.seed(0)
for _ in range(20):
    obs, reward, terminated, truncated, info = env.step(env.action_space.sample())
    total += float(reward)
    if terminated or truncated:
        break
print(f"{int(info['elapsed_steps'])} random steps: return {total:.3f}, success {bool(info['success'])}")
print(f"the pads are {float(info['target_distance']):.2f} m from the asked-for object")
env.close()
