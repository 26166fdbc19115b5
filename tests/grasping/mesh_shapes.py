"""Meshes of known shape, size and symmetry, m."""

from __future__ import annotations

import numpy as np


def prism(sides: int, radius: float, height: float, turn: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """An upright regular prism, centred; of many sides a cylinder."""
    return lathe([(0, -height / 2), (radius, -height / 2), (radius, height / 2), (0, height / 2)], sides, turn)


def lathe(profile: list[tuple[float, float]], sides: int = 64, turn: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """The surface of a profile (radius, z) from bottom to top, turned about z; closed where it ends on the axis."""
    angle = turn + 2 * np.pi * np.arange(sides) / sides
    rings, faces = [], []
    for radius, z in profile:
        rings.append(np.stack([radius * np.cos(angle), radius * np.sin(angle), np.full(sides, z)], axis=1))
    for k in range(len(profile) - 1):
        for i in range(sides):
            a, b = k * sides + i, k * sides + (i + 1) % sides
            faces += [(a, b, b + sides), (a, b + sides, a + sides)]
    return np.concatenate(rings), np.array(faces, np.int32)


def box(x: float, y: float, z: float) -> tuple[np.ndarray, np.ndarray]:
    corners = np.array([(i, j, k) for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)]) * (x / 2, y / 2, z / 2)
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return corners, np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))], np.int32)


def ball(radius: float) -> tuple[np.ndarray, np.ndarray]:
    tilt = np.linspace(-np.pi / 2, np.pi / 2, 33)
    return lathe([(radius * np.cos(t), radius * np.sin(t)) for t in tilt])


def bottle() -> tuple[np.ndarray, np.ndarray]:
    return lathe([(0, -0.1), (0.03, -0.1), (0.03, 0.03), (0.012, 0.06), (0.012, 0.1), (0, 0.1)])


def mug() -> tuple[np.ndarray, np.ndarray]:
    """A hollow cup with a handle at +x."""
    cup = lathe([(0, -0.045), (0.04, -0.045), (0.04, 0.045), (0.036, 0.045), (0.036, -0.04), (0, -0.04)])
    handle = box(0.03, 0.012, 0.06)
    return join(cup, (handle[0] + (0.052, 0, 0), handle[1]))


def join(*meshes: tuple[np.ndarray, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    starts = np.cumsum([0] + [len(v) for v, _ in meshes[:-1]])
    return np.concatenate([v for v, _ in meshes]), np.concatenate(
        [f + s for (_, f), s in zip(meshes, starts, strict=True)]
    ).astype(np.int32)


def moved(mesh: tuple[np.ndarray, np.ndarray], transform: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return mesh[0] @ transform[:3, :3].T + transform[:3, 3], mesh[1]


def write_ply(path, mesh: tuple[np.ndarray, np.ndarray], scale: float = 1.0) -> None:
    vertices, faces = mesh
    lines = ["ply", "format ascii 1.0", f"element vertex {len(vertices)}"]
    lines += [f"property float {axis}" for axis in "xyz"]
    lines += [f"element face {len(faces)}", "property list uchar int vertex_indices", "end_header"]
    lines += [" ".join(f"{x:.7g}" for x in v * scale) for v in vertices] + [f"3 {a} {b} {c}" for a, b, c in faces]
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\n".join(lines) + "\n")
