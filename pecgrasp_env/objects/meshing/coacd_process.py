"""Run as a process: CoACD on the mesh of one .npz, its convex parts into another; see `decompose`.

python coacd_process.py MESH.npz PARTS.npz name=value …
"""

import sys

import coacd
import numpy as np


def main(given: str, found: str, *settings: str) -> None:
    coacd.set_log_level("error")
    arguments = dict(setting.split("=") for setting in settings)
    typed = {name: value if name == "preprocess_mode" else _number(value) for name, value in arguments.items()}
    with np.load(given, allow_pickle=False) as mesh:
        parts = coacd.run_coacd(coacd.Mesh(mesh["vertices"], mesh["faces"]), **typed)
    points = [np.asarray(part[0], np.float64) for part in parts]
    np.savez(found, points=np.concatenate([*points, np.zeros((0, 3))]), counts=np.array([len(p) for p in points]))


def _number(text: str) -> float:
    return int(text) if text.isdecimal() else float(text)


if __name__ == "__main__":
    main(*sys.argv[1:])
