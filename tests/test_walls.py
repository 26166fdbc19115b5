"""The walls between the packages and the order inside them, read from the import statements."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
FORBIDDEN = {
    "grasping": {"torch", "pec", "pecgrasp_env", "mani_skill", "sapien", "hydra", "gymnasium"},
    "pec": {"pecgrasp_env", "grasping", "mani_skill", "sapien", "gymnasium"},
    "pecgrasp_env": set(),
}
ROOMS, FLOORS = 16, 8  # of a package, at most
COMPILED = "_kernels"  # what a package's csrc/ is built into
SIMULATORS = {"mani_skill", "sapien"}
# What also runs on a robot's computer, and what importing it must not load.
WITHOUT_SIMULATOR = {
    "pecgrasp_env.policy": SIMULATORS,
    "pecgrasp_env.motion": SIMULATORS | {"torch"},
    "pecgrasp_env.robot.kinematics": SIMULATORS | {"torch"},
    "pecgrasp_env.real": SIMULATORS | {"torch"},
}


@cache
def modules() -> dict[str, Path]:
    """Our modules by their dotted names; a package's face goes by the package's name."""
    found = {}
    for package in FORBIDDEN:
        for file in sorted((ROOT / package).rglob("*.py")):
            parts = file.relative_to(ROOT).with_suffix("").parts
            found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = file
    return found


def imported(source: str, at_import_time: bool = False) -> Iterator[str]:
    """Dotted names of all absolute imports: `a` of ``import a``, `a` and `a.b` of ``from a import b``.

    at_import_time: only those that importing the source carries out, so none in functions or type-checking blocks.
    """
    waiting: list[ast.AST] = [ast.parse(source)]
    while waiting:
        node = waiting.pop()
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.level == 0 and node.module is not None:
            yield node.module
            yield from (f"{node.module}.{alias.name}" for alias in node.names)
        elif at_import_time and isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef, ast.Lambda)):
            continue
        elif at_import_time and isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test):
            waiting += node.orelse
        else:
            waiting += ast.iter_child_nodes(node)


@cache
def needs(module: str) -> set[str]:
    """Our modules that a module's statements name, at whatever time; of ``from package import module`` the module."""
    own = modules()
    found = set()
    for node in ast.walk(ast.parse(own[module].read_text())):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.level == 0 and node.module is not None:
            names = {f"{node.module}.{alias.name}" for alias in node.names if alias.name != COMPILED}
            found |= {name if name in own else node.module for name in names}
    return found & own.keys()


def top_level(names: Iterator[str]) -> set[str]:
    return {name.split(".")[0] for name in names}


def loaded_by(module: str) -> dict[str, list[str]]:
    """All that importing a module of ours loads, by name, each with the chain of our modules that leads to it."""
    own = modules()
    chains: dict[str, list[str]] = {}
    waiting = [(module, [module])]
    while waiting:
        name, chain = waiting.pop()
        if name in chains:
            continue
        chains[name] = chain
        parent = name.rpartition(".")[0]
        if parent in own:
            waiting.append((parent, [*chain, parent]))
        if name in own:
            imports = set(imported(own[name].read_text(), at_import_time=True))
            waiting += [(each, [*chain, each]) for each in sorted(imports)]
    return chains


def test_imports_are_seen_in_every_form():
    source = "import torch.nn as nn\nfrom sapien.render import x\nfrom . import y\ndef f():\n    import scripts"
    assert top_level(imported(source)) == {"torch", "sapien", "scripts"}
    lazy = "if TYPE_CHECKING:\n    import torch\nelse:\n    import a\nclass C:\n    import b\ndef f():\n    import c"
    assert top_level(imported(lazy, at_import_time=True)) == {"a", "b"}


@pytest.mark.parametrize("package", FORBIDDEN)
def test_package_keeps_its_walls(package):
    files = sorted((ROOT / package).rglob("*.py"))
    assert files
    broken = {
        str(file.relative_to(ROOT)): sorted(crossed)
        for file in files
        if (crossed := top_level(imported(file.read_text())) & (FORBIDDEN[package] | {"scripts"}))
    }
    assert broken == {}


@pytest.mark.parametrize("package", WITHOUT_SIMULATOR)
def test_what_runs_on_a_robot_loads_no_simulator(package):
    """Neither itself nor through any module of ours that importing it imports; no file of it names one, even lazily."""
    forbidden = WITHOUT_SIMULATOR[package]
    own = [name for name in modules() if name == package or name.startswith(f"{package}.")]
    assert own or package == "pecgrasp_env.real"  # which is still to come
    loaded = {
        f"{name}: {' > '.join(chain)}"
        for name in own
        for other, chain in loaded_by(name).items()
        if other.split(".")[0] in forbidden
    }
    named = {name for name in own if top_level(imported(modules()[name].read_text())) & forbidden}
    assert (loaded, named) == (set(), set())


def test_no_modules_import_each_other_in_a_circle():
    """Not even lazily: each file can be read without knowing what builds on it."""
    done: set[str] = set()
    circles = []

    def walk(name: str, path: list[str]) -> None:
        if name in path:
            circles.append([*path[path.index(name) :], name])
        elif name not in done:
            for other in sorted(needs(name)):
                walk(other, [*path, name])
            done.add(name)

    for name in modules():
        walk(name, [])
    assert circles == []


def test_a_packages_face_is_imported_by_nobody_inside_it():
    own = modules()
    faces = {name for name, file in own.items() if file.name == "__init__.py"}
    inside = {
        f"{name} imports {face}"
        for name in own
        for face in needs(name) & faces
        if name.startswith(f"{face}.") and name != face
    }
    assert inside == set()


@pytest.mark.parametrize("package", FORBIDDEN)
def test_a_package_has_few_rooms_on_few_floors(package):
    """A room is a folder or module at its top, or its face; it stands a floor above the highest room that it needs."""
    below: dict[str, set[str]] = {}
    for name in modules():
        if name.split(".")[0] == package:
            own = ".".join(name.split(".")[:2])
            rooms = {".".join(other.split(".")[:2]) for other in needs(name) if other.split(".")[0] == package}
            below.setdefault(own, set()).update(rooms - {own})
    floor: dict[str, int] = {}
    for room in TopologicalSorter(below).static_order():  # which raises where rooms need each other
        floor[room] = 1 + max((floor[other] for other in below[room]), default=0)
    assert len(floor) <= ROOMS
    assert max(floor.values()) <= FLOORS
