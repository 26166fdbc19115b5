"""The scripted policy picks an object: it sees depth, joint angles and gripper, and nothing of the simulator.

    python examples/06_expert.py [CLASSIFIER]

CLASSIFIER: a checkpoint of the classes on the table, such as `pecgrasp train` leaves. Without one a single object
lies there, and needs none.
"""

import sys

import gymnasium as gym

import pecgrasp_env  # noqa: F401  registers the environments
from pecgrasp_env import ScriptedPolicy

classifier = None
scene = {"n_objects": 1, "classes": ["stapler"]}
if len(sys.argv) > 1:
    from pec import Classifier

    classifier = Classifier.load(sys.argv[1])
    scene = {"n_objects": 3, "classes": classifier.classes}

env = gym.make("SelectiveGrasp-v1", obs_mode="depth", control_mode="pd_joint_pos", sensor="d435", **scene)
env.unwrapped.pictures_on_demand = True  # the policy looks once or twice: the other frames are not rendered
policy = ScriptedPolicy(classifier)

obs, info = env.reset(seed=0)
policy.reset(info["target"][0])
over = False
while not (over or policy.done):
    obs, reward, terminated, truncated, info = env.step(policy.act(obs))
    over = bool(terminated) or bool(truncated)

print(f"{info['target'][0]}: {'lifted' if bool(info['success']) else policy.log.reason or 'not lifted'}")
print(f"{int(info['elapsed_steps'])} steps, {policy.log.views} looks, failed tries: {policy.log.failures or 'none'}")
env.close()
