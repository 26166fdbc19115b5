"""Which code a result was made by: a hash of the modules that it goes through, and of the libraries' versions."""

from __future__ import annotations

import ast
import hashlib
import importlib.metadata
from functools import cache
from pathlib import Path

__all__ = ["CodeVersionError", "code_version"]

_ROOT = Path(__file__).parents[2]
_PACKAGES = ("grasping", "pec", "pecgrasp_env")


class CodeVersionError(ImportError):
    """A module that a result goes through is not where its name says; the message has the name and who imports it."""


def code_version(begin: tuple[str, ...], libraries: tuple[str, ...], root: Path = _ROOT) -> str:
    """16 hexadecimal digits that differ where a result could; comments and docstrings do not count.

    Args:
        begin: our modules from which on imports lead to all that has a part in the result; those inside functions
            count. All C of a package, and what packages share, counts as soon as one of its modules is reached.
        libraries: distributions whose versions count.
        root: the folder of our packages.

    Raises:
        CodeVersionError: a module of ours is missing: one of `begin`, or one that a reached module imports.
    """
    digest = hashlib.sha256()
    for name in libraries:
        digest.update(f"{name} {importlib.metadata.version(name).split('+')[0]}\n".encode())
    reached = _reached(begin, root)
    for path in sorted(reached):
        digest.update(f"{path.relative_to(root).as_posix()}\n{_statements(path.read_text())}\n".encode())
    folders = {path.relative_to(root).parts[0] for path in reached} | {"csrc"}  # which both compiled modules share
    for path in sorted(file for folder in folders for file in (root / folder).rglob("*.[ch]")):
        digest.update(path.relative_to(root).as_posix().encode() + path.read_bytes())
    return digest.hexdigest()[:16]


def _reached(begin: tuple[str, ...], root: Path) -> set[Path]:
    """Files of our modules that `begin` imports, directly or not."""
    reached: set[Path] = set()
    waiting = {_file_of(root, name, "the list of modules to begin with") for name in begin}
    while waiting:
        path = waiting.pop()
        reached.add(path)
        for module, names in _imports(path.read_text()):
            if module.split(".")[0] in _PACKAGES:
                waiting.add(_file_of(root, module, path))
                waiting |= {file for name in names if (file := _find(root, f"{module}.{name}")) is not None}
        waiting -= reached
    return reached


@cache
def _imports(source: str) -> list[tuple[str, list[str]]]:
    """The modules that a source imports, and the names that it takes from each, which may be modules, too."""
    found: list[tuple[str, list[str]]] = []
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            found += [(alias.name, []) for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module:
            found.append((node.module, [alias.name for alias in node.names]))
    return found


def _file_of(root: Path, module: str, importer: object) -> Path:
    file = _find(root, module)
    if file is None:
        raise CodeVersionError(f"{importer} names the module {module}, which is not below {root}")
    return file


def _find(root: Path, module: str) -> Path | None:
    path = root.joinpath(*module.split("."))
    for file in (path / "__init__.py", path.parent / f"{path.name}.py", path.parent / f"{path.name}.pyi"):
        if file.is_file():
            return file
    return None


@cache
def _statements(source: str) -> str:
    tree = ast.parse(source)
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef):
            node.body = [
                statement
                for statement in node.body
                if not (isinstance(statement, ast.Expr) and isinstance(statement.value, ast.Constant))
            ]
    return ast.dump(tree)
