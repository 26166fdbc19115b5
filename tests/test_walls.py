"""The walls between the packages, read from their import statements."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
FORBIDDEN = {
    "grasping": {"torch", "pec", "pecgrasp_env", "mani_skill", "sapien", "hydra", "gymnasium"},
    "pec": {"pecgrasp_env", "grasping", "mani_skill", "sapien", "gymnasium"},
    "pecgrasp_env": set(),
}


def imported_packages(source: str) -> set[str]:
    """Top-level package of every import in the source, those inside functions and type-checking blocks included."""
    found = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            found |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.level == 0:
            found.add((node.module or "").split(".")[0])
    return found


def test_imported_packages_sees_every_form():
    source = "import torch.nn as nn\nfrom sapien.render import x\nfrom . import y\ndef f():\n    import scripts"
    assert imported_packages(source) == {"torch", "sapien", "scripts"}


@pytest.mark.parametrize("package", FORBIDDEN)
def test_package_keeps_its_walls(package):
    files = sorted((ROOT / package).rglob("*.py"))
    assert files
    broken = {
        str(file.relative_to(ROOT)): sorted(crossed)
        for file in files
        if (crossed := imported_packages(file.read_text()) & (FORBIDDEN[package] | {"scripts", "pecgrasp"}))
    }
    assert broken == {}
