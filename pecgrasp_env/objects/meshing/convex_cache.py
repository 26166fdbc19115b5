"""The convex parts of meshes, each found once and kept in the cache folder, whoever else looks for them meanwhile."""

from __future__ import annotations

import fcntl
import hashlib
import io
from importlib.metadata import version
from pathlib import Path

import numpy as np

from grasping.errors import DAMAGED_NPZ
from pec.common.atomic_files import write_whole
from pecgrasp_env.objects.meshing.convex_decomposition import COACD, MOST_FACES, decompose
from pecgrasp_env.objects.meshing.mesh_cache import cache_folder

__all__ = ["convex_parts"]


def convex_parts(vertices: np.ndarray, faces: np.ndarray) -> list[np.ndarray]:
    """Convex parts of a mesh (V, 3), (F, 3), as (K, 3) each, in its unit.

    The file is named by the hash of the mesh, of the way of finding them and of CoACD's version. While a process looks
    for them, others that want the same wait for it; a file that is broken is made anew.
    """
    used, index = np.unique(faces, return_inverse=True)
    vertices = np.ascontiguousarray(vertices[used], np.float64)
    faces = np.ascontiguousarray(index.reshape(-1, 3), np.int32)
    digest = hashlib.sha256(vertices.tobytes() + faces.tobytes())
    digest.update(f"{sorted(COACD.items())} {MOST_FACES} coacd {version('coacd')}".encode())
    path = cache_folder() / f"{digest.hexdigest()[:32]}.coacd.npz"
    parts = _stored(path)
    if parts is None:
        path.parent.mkdir(parents=True, exist_ok=True)
        lock = path.with_suffix(".lock")
        with lock.open("w") as held:
            fcntl.flock(held, fcntl.LOCK_EX)  # it goes with the process, however that ends
            parts = _stored(path)
            if parts is None:
                parts = decompose(vertices, faces)
                buffer = io.BytesIO()
                counts = np.array([len(p) for p in parts], np.int64)
                np.savez(buffer, points=np.concatenate([*parts, np.empty((0, 3))]), counts=counts)
                write_whole(path, buffer.getvalue())
            lock.unlink(missing_ok=True)
    return parts


def _stored(path: Path) -> list[np.ndarray] | None:
    """What the file holds, or None where there is none or it cannot be read."""
    try:
        with np.load(path, allow_pickle=False) as stored:
            points, counts = stored["points"], stored["counts"]
    except DAMAGED_NPZ:
        return None
    return np.split(points, np.cumsum(counts)[:-1]) if len(counts) else []
