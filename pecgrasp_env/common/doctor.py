"""Says what renders on this machine, with which Vulkan driver, and what to do where nothing does.

    python -m pecgrasp_env.common.doctor            a readable report
    python -m pecgrasp_env.common.doctor --quiet    exit status only: 0 renders, 1 does not

A driver that SAPIEN cannot use may end the process instead of raising, so the trial picture is taken in a child.
"""

from __future__ import annotations

import importlib.metadata
import json
import platform
import shutil
import subprocess
import sys
from pathlib import Path

import grasping

PACKAGES = ("mani-skill", "sapien", "gymnasium", "torch", "numpy", "scipy", "trimesh", "coacd", "hydra-core")

# Half a metre in front of the camera stands a box's face: a driver that draws returns -0.5 as its depth. What a driver
# lacks shows when the device is opened; of the shaders the one without light is made in half a second, others in ten.
TRIAL = """
import json, sapien
sapien.render.set_camera_shader_dir("trivial")
scene = sapien.Scene()
builder = scene.create_actor_builder()
builder.add_box_visual(half_size=[0.1, 0.1, 0.1])
builder.build_static(name="box").set_pose(sapien.Pose([0.6, 0.0, 0.0]))
camera = scene.add_camera("probe", 32, 32, 1.0, 0.01, 5.0)
scene.update_render()
camera.take_picture()
depth = -float(camera.get_picture("Position")[16, 16, 2])
print(json.dumps({"devices": sapien.render.get_device_summary(), "depth_m": depth}))
"""

ADVICE = """\
SAPIEN found no Vulkan device that it can draw with. It needs a GPU driver with Vulkan, or Mesa's software driver,
version 23 or newer. With root, `make demo` or `make test` install it. By hand:
  Debian 13, Ubuntu 24.04 and newer:  apt-get install libvulkan1 mesa-vulkan-drivers
  Debian 12:                          the same from bookworm-backports (-t bookworm-backports), as 22.3 is too old
  other systems:                      the packages that bring the Vulkan loader and Mesa's lavapipe driver"""


def render_trial(timeout: float = 120.0) -> tuple[bool, str]:
    """Draw one small picture in a child process.

    Returns whether the depth came out right, and SAPIEN's list of Vulkan devices or the last lines of what went wrong.
    """
    try:
        child = subprocess.run([sys.executable, "-c", TRIAL], capture_output=True, text=True, timeout=timeout)
    except subprocess.TimeoutExpired:
        return False, f"no picture within {timeout:.0f} s"
    if child.returncode != 0:
        return False, "\n".join(child.stderr.strip().splitlines()[-3:]) or f"the process ended with {child.returncode}"
    answer = json.loads(child.stdout.strip().splitlines()[-1])
    if abs(answer["depth_m"] - 0.5) > 1e-3:
        return False, f"a box at 0.5 m was drawn at {answer['depth_m']:.4f} m"
    return True, answer["devices"].strip()


def vulkan_driver_files() -> list[str]:
    """Vulkan drivers that the loader's manifests announce on this machine."""
    folders = [Path("/usr/share/vulkan/icd.d"), Path("/etc/vulkan/icd.d"), Path("/usr/local/share/vulkan/icd.d")]
    return sorted(str(file) for folder in folders if folder.is_dir() for file in folder.glob("*.json"))


def package_versions() -> dict[str, str]:
    """Installed version of each package that the environment stands on, or "missing"."""
    versions = {}
    for package in PACKAGES:
        try:
            versions[package] = importlib.metadata.version(package)
        except importlib.metadata.PackageNotFoundError:
            versions[package] = "missing"
    return versions


def main(arguments: list[str]) -> int:
    """Print the report (or nothing with --quiet); 0 where SAPIEN renders, 1 where it does not."""
    if arguments not in ([], ["--quiet"]):
        print(f"doctor: unknown arguments {arguments}; there is only --quiet", file=sys.stderr)
        return 2
    renders, detail = render_trial()
    if arguments == ["--quiet"]:
        return 0 if renders else 1
    print(f"Python   {platform.python_version()} on {platform.platform()}")
    print("Packages " + ", ".join(f"{name} {version}" for name, version in package_versions().items()))
    print("Grasping " + ("compiled kernels" if grasping.compiled else "NumPy alone: no kernels were compiled"))
    print("Drivers  " + (", ".join(vulkan_driver_files()) or "no Vulkan driver manifest found"))
    print("GPU      " + ("nvidia-smi is there" if shutil.which("nvidia-smi") else "no nvidia-smi: physics on the CPU"))
    if renders:
        print(f"Renders  yes\n{detail}")
        return 0
    print(f"Renders  NO: {detail}\n{ADVICE}")
    return 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
