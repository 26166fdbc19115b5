"""Each numbered example runs as its docstring says, in a process of its own, and says what it promises."""

import os
import re
import runpy
import subprocess
import sys
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parents[2] / "examples"
SAYS = {
    "01_plan_on_a_file": r"\d+ grasps; the best, score 0\.\d\d",
    "02_segment_a_frame": r"4 objects(?s:.*)object 3, \d+ points: held at",
    "03_classify": r"a ball is called ball",
    "04_own_meshes": r"test accuracy: (?:[89]\d|100) %",
    "05_environment": r"20 random steps: return",
    "06_expert": r"stapler: lifted",
    "07_own_planner": r"(?:can_\d{4}: success.*\n?){3}",
    "08_own_object_class": r"dumbbell: 2 instances, 20 clouds",
}

SLOW = {
    "04_own_meshes",
    "05_environment",
    "06_expert",
    "07_own_planner",
    "08_own_object_class",
}  # data sets and episodes


def run(name: str, *arguments: str) -> str:
    """What the example prints. It sees the repository, whether or not this is installed."""
    environment = {
        **os.environ,
        "PYTHONPATH": os.pathsep.join([str(EXAMPLES.parent), os.environ.get("PYTHONPATH", "")]),
    }
    command = [sys.executable, str(EXAMPLES / f"{name}.py"), *arguments]
    done = subprocess.run(command, capture_output=True, text=True, env=environment, timeout=600)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.slow) if name in SLOW else name for name in SAYS]
)
def test_example(name):
    assert re.search(SAYS[name], run(name))


@pytest.mark.slow
def test_own_network(tmp_path):
    runpy.run_path(str(EXAMPLES / "03_classify.py"))["write_clouds"](tmp_path / "clouds")
    said = run("09_own_network", str(tmp_path / "clouds"), str(tmp_path / "tiny"))
    assert "a classifier of ball, plate, rod" in said


def test_every_example_is_numbered_short_and_tested():
    files = sorted(EXAMPLES.glob("*.py"))
    assert {file.stem for file in files} == {*SAYS, "09_own_network"}
    for number, file in enumerate(files, 1):
        assert file.name.startswith(f"{number:02}_")
        assert len(file.read_text().splitlines()) < 60, file.name


def test_notebook_walks_from_a_frame_to_a_grasp(monkeypatch):
    nbformat, nbclient = pytest.importorskip("nbformat"), pytest.importorskip("nbclient")
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(EXAMPLES.parent), os.environ.get("PYTHONPATH", "")]))
    file = EXAMPLES / "frame_to_grasp.ipynb"
    assert file.stat().st_size < 300_000  # with its pictures
    notebook = nbformat.read(file, as_version=4)
    nbclient.NotebookClient(notebook, timeout=300, resources={"metadata": {"path": str(EXAMPLES)}}).execute()
    outputs = [output for cell in notebook.cells for output in cell.get("outputs", [])]
    assert sum("image/png" in output.get("data", {}) for output in outputs) == 3
    assert any("mm, score 0." in output.get("text", "") for output in outputs)
