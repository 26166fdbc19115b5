"""`pecgrasp COMMAND …`: finds the command's module and calls it; imports nothing else, so that help comes at once."""

from __future__ import annotations

import sys
from importlib import import_module
from importlib.util import find_spec

__all__ = ["COMMANDS", "main"]

# Command → the extra that it needs, and what it does.
COMMANDS: dict[str, tuple[str | None, str]] = {
    "plan": (None, "grasps on a cloud, a depth frame or a folder of them"),
    "segment": (None, "cut a cloud or a depth frame into objects"),
    "calibrate": ("calibrate", "where the camera is, by a printed board"),
    "estimate-pose": ("pose", "where known objects lie in a cloud"),
    "generate": ("sim", "labelled clouds of objects, as the robot sees them"),
    "generate-scenes": ("sim", "labelled frames of crowded tables, for the segmenter"),
    "generate-grasps": ("sim", "grasps that were tried on objects, with what became of them"),
    "cut-scenes": ("sim", "clouds of single objects, cut out of labelled frames"),
    "train": ("learn", "a classifier"),
    "train-pose": ("learn", "proposals of the poses of known objects"),
    "train-grasps": ("learn", "what judges or proposes grasps, from their labels"),
    "train-points": ("sim", "a class for every point of a table"),
    "train-segmenter": ("segmenter", "the segmenter, for another camera"),
    "classify": ("learn", "one cloud, with a trained classifier"),
    "evaluate": ("sim", "the policy in simulation, or a grid of scenes and planners"),
    "evaluate-dual": ("sim", "two arms that lift one long or heavy thing"),
    "try-planners": ("sim", "planners' first grasps by a hand alone, on the same scenes"),
    "evaluate-pose": ("sim", "how well poses of known objects are found"),
    "evaluate-points": ("sim", "a class for every point against one for every cut-out"),
    "ablate": ("learn", "train a grid, beside the published figures"),
    "compare": ("learn", "trained classifiers, cloud by cloud"),
    "strangers": ("sim", "whether a classifier knows what it does not know"),
    "robustness": ("learn", "trained classifiers on corrupted clouds"),
    "export-onnx": ("onnx", "a trained classifier for other runtimes"),
    "pick": ("ur", "one object by its name, with an arm of one's own"),
    "teach": ("learn", "a class to a classifier, from the thing itself"),
    "replay-pick": (None, "a pick that was recorded, planned again"),
    "fake-robot": (None, "an arm that is not there, for trying the way to it"),
    "record-demos": ("sim", "trajectories of the scripted policy"),
    "export-lerobot": ("lerobot", "recorded episodes as a LeRobot data set"),
    "train-bc": ("sim", "a policy from recorded trajectories"),
    "transfer": ("sim", "what realistic training clouds are worth"),
    "published-figures": ("sim", "how often the dissertation's figures come true"),
    "contact-sheet": ("sim", "a picture of the objects"),
    "benchmark": ("sim", "how fast each part is"),
    "demo": ("sim", "all of it, in at most ten minutes"),
    "doctor": (None, "what works on this machine, and how to mend what does not"),
}

# What the extras of pyproject.toml bring, by import name.
EXTRAS = {
    "calibrate": ("cv2",),
    "segmenter": ("torch", "tqdm", "mani_skill", "sapien", "sklearn"),
    "learn": ("torch", "safetensors", "tqdm", "tensorboard"),
    "ur": ("rtde_control", "rtde_receive", "dashboard_client"),
    "pose": ("trimesh",),
    "lerobot": ("pyarrow", "h5py"),
    "onnx": ("torch", "safetensors", "onnx", "onnxscript", "onnxruntime"),
    "sim": ("torch", "tqdm", "mani_skill", "sapien", "gymnasium", "trimesh", "coacd", "h5py", "PIL", "imageio_ffmpeg"),
}


def usage() -> str:
    first = "usage: pecgrasp COMMAND [KEY=VALUE …] [--config-dir OWN]   more: COMMAND --help"
    return "\n".join([first, *(f"  {name:18} {what}" for name, (_, what) in COMMANDS.items())])


def main(command: str | None = None) -> None:
    """Run a command with what stands behind it in `sys.argv`; without an argument `sys.argv[1]` names it."""
    if command is None:
        command, *arguments = sys.argv[1:] or ["--help"]
        if command in ("-h", "--help"):
            print(usage())
            return
        if command not in COMMANDS:
            sys.exit(f"pecgrasp: no command {command!r}; there are {', '.join(COMMANDS)}")
        sys.argv = [f"pecgrasp {command}", *arguments]
    extra, _ = COMMANDS[command]
    if extra is not None and (missing := [name for name in EXTRAS[extra] if find_spec(name) is None]):
        sys.exit(f"pecgrasp {command} needs pip install 'pecgrasp[{extra}]' (missing: {', '.join(missing)})")
    import_module(f"pecgrasp.commands.{command.replace('-', '_')}").main()
