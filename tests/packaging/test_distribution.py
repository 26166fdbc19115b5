"""What is built from the tree: the sdist is whole, and its wheel works in an environment that never saw the clone."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import sysconfig
import tarfile
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PACKAGES = ("grasping", "pec", "pecgrasp", "pecgrasp_env")
NOT_TRACKED = (".*", "__pycache__", "*.so", "*.egg-info", "build", "dist", "outputs", "multirun", "demo_output", "site")
ENVIRONMENT = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}  # so no clone is importable


def run(*words: str | Path, cwd: Path) -> str:
    ended = subprocess.run([str(word) for word in words], cwd=cwd, env=ENVIRONMENT, capture_output=True, text=True)
    assert ended.returncode == 0, f"{ended.stdout[-3000:]}\n{ended.stderr[-3000:]}"
    return ended.stdout


def build(kind: str, source: Path, into: Path) -> Path:
    """What `python -m build --no-isolation` makes."""
    hook = f"import sys; from setuptools import build_meta; build_meta.build_{kind}(sys.argv[1])"
    run(sys.executable, "-c", hook, into, cwd=source)
    (made,) = into.glob({"sdist": "*.tar.gz", "wheel": "*.whl"}[kind])
    return made


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the tree: a build leaves files in it."""
    copy = tmp_path_factory.mktemp("clone") / "pecgrasp"
    shutil.copytree(ROOT, copy, ignore=shutil.ignore_patterns(*NOT_TRACKED))
    return copy


@pytest.fixture(scope="module")
def sdist(source: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The sdist, unpacked."""
    folder = tmp_path_factory.mktemp("sdist")
    with tarfile.open(build("sdist", source, folder)) as archive:
        archive.extractall(folder / "unpacked", filter="data")
    (unpacked,) = (folder / "unpacked").iterdir()
    return unpacked


def files(root: Path, *folders: str) -> set[str]:
    return {
        path.relative_to(root).as_posix()
        for folder in folders
        for path in (root / folder).rglob("*")
        if path.is_file() and "__pycache__" not in path.parts
    }


def test_the_sdist_holds_every_file_of_the_packages_the_configs_and_the_tests(source: Path, sdist: Path) -> None:
    folders = (*PACKAGES, "conf", "csrc", "scripts", "tests")
    assert files(sdist, *folders) == files(source, *folders)
    assert {"README.md", "LICENSE", "pyproject.toml", "setup.py"} <= {path.name for path in sdist.iterdir()}


def test_what_is_installed_holds_every_file_of_the_packages_and_the_configs(source: Path, tmp_path: Path) -> None:
    run(sys.executable, "setup.py", "-q", "build_py", "--build-lib", tmp_path, cwd=source)
    configs = {f"pecgrasp/{name}" for name in files(source, "conf")}
    # The C, too: the version of the code that made a result counts it.
    assert files(tmp_path, *PACKAGES) == files(source, *PACKAGES) | configs


@pytest.mark.slow
def test_the_wheel_of_the_sdist_plans_and_passes_the_planners_tests_outside_of_the_clone(
    sdist: Path, tmp_path: Path
) -> None:
    wheel = build("wheel", sdist, tmp_path)
    assert "-cp310-abi3-" in wheel.name or sys.version_info < (3, 11)
    names = zipfile.ZipFile(wheel).namelist()
    assert {name.split("/")[0] for name in names if ".dist-info" not in name} == set(PACKAGES)
    assert sum("/_kernels." in name and not name.endswith(".pyi") for name in names) == 4
    run(sys.executable, "-m", "venv", "--without-pip", "venv", cwd=tmp_path)
    python = tmp_path / "venv/bin/python"
    run(sys.executable, "-m", "pip", "--python", python, "install", "--no-deps", "--no-index", wheel, cwd=tmp_path)
    # Other packages come from here, and nothing is downloaded. An editable install stays out: its own .pth is not read.
    site = Path(run(python, "-c", "import sysconfig; print(sysconfig.get_path('purelib'))", cwd=tmp_path).strip())
    (site / "others.pth").write_text("\n".join({sysconfig.get_path("purelib"), sysconfig.get_path("platlib")}))
    work = tmp_path / "work"
    for name in ("tests", "conf", "docs", "examples"):
        shutil.copytree(sdist / name, work / name)
    for name in ("README.md", "pyproject.toml"):
        shutil.copy(sdist / name, work)
    program = "import grasping, pec, pecgrasp; print(grasping.__file__, pec.__file__, pecgrasp.__file__)"
    assert all(Path(file).is_relative_to(site) for file in run(python, "-c", program, cwd=work).split())
    assert run(python, "-c", "import grasping; print(grasping.compiled)", cwd=work) == "True\n"
    (work / "box.xyz").write_text("\n".join(f"{x} {y} {z}" for x in range(50) for y in range(40) for z in (29, 30)))
    planned = run(tmp_path / "venv/bin/pecgrasp", "plan", "box.xyz", "scale=0.001", "frame=world", cwd=work)
    assert "box.xyz" in planned
    assert (work / "outputs/plan/plan.html").exists()
    run(python, "-m", "pytest", "-q", "-p", "no:cacheprovider", "tests/grasping", cwd=work)
