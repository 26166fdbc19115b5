"""Digests of what the packages compute, to the last bit, so that a refactoring can show that it changed nothing.

python tests/golden/digests.py OUT.json [--only ITEM ...] [--keep DIR] [--old DIR]
python tests/golden/digests.py --compare BEFORE.json AFTER.json

It tests the checkout that it lies in, whatever is installed. See README.md beside it.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import shutil
import sys
import tempfile
import time
from collections.abc import Callable, Mapping
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any

from golden_digest import Values, digest, in_a_fresh_process
from golden_tools import ROOT, read_json

LIBRARIES = ("numpy", "scipy", "torch", "sapien", "mani-skill", "gymnasium", "trimesh", "coacd", "safetensors")
Item = Callable[[], Values]


def use_this_checkout() -> None:
    """Its packages, one core and no GPU, here and in processes that are started; before anything is imported."""
    sys.path.insert(0, str(ROOT))
    os.environ |= {"PYTHONPATH": str(ROOT), "CUDA_VISIBLE_DEVICES": "", "OMP_NUM_THREADS": "1", "LP_NUM_THREADS": "1"}
    os.environ["PYTHONHASHSEED"] = "0"  # ManiSkill lists the pictures of an observation in the order of a set
    import torch

    import grasping
    import pec

    torch.set_num_threads(1)
    if not all(Path(package.__file__).is_relative_to(ROOT) and package.compiled for package in (grasping, pec)):
        sys.exit(f"digests: {grasping.__file__} is not of {ROOT}, or the kernels are not built (README.md says how)")


def items(work: Path, old: Path | None) -> dict[str, Item]:
    """By name, in an order in which what one needs has been made by those before it; else it makes that itself."""
    import golden_episodes as simulation
    import golden_grasping as grasping
    import golden_learning as learning

    known: dict[str, Item] = {
        "plans": partial(grasping.plans, compiled=True),
        "plans_numpy": partial(grasping.plans, compiled=False),
        "plans_of_others": grasping.plans_of_others,
        "scenes": grasping.scenes,
        "fused": grasping.fused,
        "planned_files": partial(grasping.planned_files, work),
        "data_sets": partial(learning.data_sets, work),
        "trained": partial(learning.trained, work),
        "predictions": partial(learning.predictions, work),
        "episodes_apart": partial(in_a_fresh_process, simulation.episodes, "apart"),
        "episodes_close": partial(in_a_fresh_process, simulation.episodes, "close"),
        "episodes_touching": partial(in_a_fresh_process, simulation.episodes, "touching"),
        "observations": partial(in_a_fresh_process, simulation.observations),
    }
    return known if old is None else {**known, "old_files": partial(learning.old_files, work, old.resolve())}


def machine() -> dict[str, str]:
    """What may change digests without a change of the code."""
    cpu = Path("/proc/cpuinfo")
    lines = cpu.read_text().splitlines() if cpu.exists() else []
    model = next((line.partition(":")[2].strip() for line in lines if line.startswith("model name")), "unknown")
    versions = {name: version(name) for name in LIBRARIES}
    return {"cpu": model, "system": platform.platform(), "python": platform.python_version(), **versions}


def write_digests(out: Path, only: list[str] | None, keep: Path | None, old: Path | None) -> None:
    use_this_checkout()
    with tempfile.TemporaryDirectory() as folder:
        work = Path(folder)
        known = items(work, old)
        if unknown := set(only or ()) - known.keys():
            sys.exit(f"digests: no item {', '.join(sorted(unknown))}; there are {', '.join(known)}")
        result: dict[str, Any] = {"machine": machine(), "seconds": {}, "digests": {}}
        for name in only or known:
            begin = time.perf_counter()
            result["digests"][name] = {case: digest(value) for case, value in known[name]()}
            result["seconds"][name] = round(time.perf_counter() - begin, 1)
            print(f"{name:20}{len(result['digests'][name]):5} digests{result['seconds'][name]:8.1f} s", flush=True)
            out.write_text(json.dumps(result, indent=1) + "\n")
        for part in ("data", "runs") if keep else ():
            shutil.copytree(work / part, keep / part, dirs_exist_ok=True)


def compare(before: Path, after: Path) -> int:
    """Say what differs; the number of items that do."""
    one, other = read_json(before), read_json(after)
    for name, value in one["machine"].items():
        if other["machine"].get(name) != value:
            print(f"note: {name} was {value}, now {other['machine'].get(name)}")
    differing = 0
    for item in {**one["digests"], **other["digests"]}:
        if item not in one["digests"] or item not in other["digests"]:
            print(f"{item:20} not compared: only in {before if item in one['digests'] else after}")
            continue
        wrong = different(one["digests"][item], other["digests"][item])
        differing += bool(wrong)
        told = f"{len(wrong)} DIFFER: {', '.join(wrong[:10])}" if wrong else "all equal"
        print(f"{item:20}{len(one['digests'][item]):5} digests, {told}")
    return differing


def different(one: Mapping[str, str], other: Mapping[str, str]) -> list[str]:
    return [name for name in {**one, **other} if one.get(name) != other.get(name)]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path, nargs="?", help="where the digests go")
    parser.add_argument("--only", nargs="+", metavar="ITEM", help="make only these items")
    parser.add_argument("--keep", type=Path, metavar="DIR", help="leave the data sets and the training runs there")
    parser.add_argument("--old", type=Path, metavar="DIR", help="also read what an earlier version kept there")
    parser.add_argument("--compare", type=Path, nargs=2, metavar=("BEFORE", "AFTER"))
    chosen = parser.parse_args()
    if chosen.compare:
        sys.exit(1 if compare(*chosen.compare) else 0)
    if chosen.out is None:
        parser.error("say where the digests go: OUT.json")
    write_digests(chosen.out, chosen.only, chosen.keep, chosen.old)


if __name__ == "__main__":
    main()
