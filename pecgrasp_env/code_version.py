"""Which code an episode is made by: a hash of the modules that it goes through, and of the simulator's versions."""

from __future__ import annotations

import ast
import hashlib
import importlib.metadata
from functools import cache
from pathlib import Path

_ROOT = Path(__file__).parents[1]
_PACKAGES = ("grasping", "pec", "pecgrasp_env")
# From these on, imports lead to all that has a part in an episode; `grasping` to every planner.
_BEGIN = ("pecgrasp_env.episode", "pecgrasp_env.selective_grasp", "pecgrasp_env.policy", "pec.classifier")
_LIBRARIES = ("mani-skill", "sapien", "torch", "numpy", "scipy")


@cache
def code_version(root: Path = _ROOT) -> str:
    """16 hexadecimal digits that differ where an episode could; comments and docstrings do not count.

    root: the folder of the three packages.
    """
    digest = hashlib.sha256()
    for name in _LIBRARIES:
        digest.update(f"{name} {importlib.metadata.version(name).split('+')[0]}\n".encode())
    for path in sorted(_reached(root)):
        digest.update(f"{path.relative_to(root).as_posix()}\n{_statements(path)}\n".encode())
    for path in sorted(file for package in _PACKAGES for file in (root / package).glob("*.[ch]")):
        digest.update(path.name.encode() + path.read_bytes())
    return digest.hexdigest()[:16]


def _reached(root: Path) -> set[Path]:
    """Files of our modules that `_BEGIN` imports, directly or not, inside functions as well."""
    reached: set[Path] = set()
    waiting = {path for name in _BEGIN if (path := _file_of(root, name)) is not None}
    while waiting:
        path = waiting.pop()
        reached.add(path)
        for node in ast.walk(ast.parse(path.read_text())):
            names: list[str] = []
            if isinstance(node, ast.Import):
                names = [alias.name for alias in node.names]
            elif isinstance(node, ast.ImportFrom) and node.module:
                names = [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
            found = {_file_of(root, name) for name in names if name.split(".")[0] in _PACKAGES}
            waiting |= {file for file in found if file is not None} - reached
    return reached


def _file_of(root: Path, module: str) -> Path | None:
    path = root.joinpath(*module.split("."))
    for file in (path.with_suffix(".py"), path / "__init__.py"):
        if file.is_file():
            return file
    return None


def _statements(path: Path) -> str:
    tree = ast.parse(path.read_text())
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef):
            node.body = [
                statement
                for statement in node.body
                if not (isinstance(statement, ast.Expr) and isinstance(statement.value, ast.Constant))
            ]
    return ast.dump(tree)
