"""The version of the code that results are made by: on a copy of the real tree, and on a tiny one."""

import shutil
from pathlib import Path

import pytest

from pec.experiments import grid as training_grid
from pec.experiments.code_version import CodeVersionError, code_version
from pecgrasp_env.evaluation import grid as evaluation_grid

ROOT = Path(__file__).parents[1]
TRAINING, EPISODES = training_grid._CODE, evaluation_grid._CODE


@pytest.fixture
def tree(tmp_path):
    for package in ("grasping", "pec", "pecgrasp_env", "csrc"):
        shutil.copytree(ROOT / package, tmp_path / package, ignore=shutil.ignore_patterns("__pycache__", "*.so"))
    return tmp_path


def test_it_is_the_same_wherever_the_tree_lies(tree):
    assert code_version(*TRAINING, root=tree) == training_grid.cell_code()
    assert code_version(*EPISODES, root=tree) == evaluation_grid.cell_code()


@pytest.mark.parametrize(
    ("file", "changes_training", "changes_episodes"),
    [
        ("pec/preprocessing/ordering.py", True, True),
        ("pec/training/loop.py", True, False),
        ("pec/experiments/comparison.py", False, False),
        ("grasping/curvature_planner/scoring.py", False, True),
        ("grasping/baselines/geograsp.py", False, True),
        ("grasping/plan_files/page.py", False, False),
        ("pecgrasp_env/motion/rrt_connect.py", False, True),
        ("pecgrasp_env/demo/report.py", False, False),
    ],
)
def test_it_changes_with_the_statements_that_a_result_goes_through(tree, file, changes_training, changes_episodes):
    before = [code_version(*begin, root=tree) for begin in (TRAINING, EPISODES)]
    source = (tree / file).read_text()
    (tree / file).write_text("# A remark.\n" + source)
    assert [code_version(*begin, root=tree) for begin in (TRAINING, EPISODES)] == before
    (tree / file).write_text(source + "\nEXTRA = 1\n")
    after = [code_version(*begin, root=tree) for begin in (TRAINING, EPISODES)]
    assert [new != old for new, old in zip(after, before, strict=True)] == [changes_training, changes_episodes]


@pytest.mark.parametrize(
    ("folder", "changes_training"),
    [("pec/preprocessing/csrc", True), ("grasping/curvature_planner/csrc", False), ("csrc", True)],
)
def test_it_changes_with_the_c_in_sub_folders(tree, folder, changes_training):
    before = code_version(*EPISODES, root=tree), code_version(*TRAINING, root=tree)
    source = next((tree / folder).glob("*.[ch]"))
    source.write_text(source.read_text() + "int extra;\n")
    assert code_version(*EPISODES, root=tree) != before[0]
    assert (code_version(*TRAINING, root=tree) != before[1]) == changes_training


def test_a_module_to_begin_with_that_has_moved_is_an_error(tree):
    (tree / "pec/classifier.py").rename(tree / "pec/classification.py")
    with pytest.raises(CodeVersionError, match=r"list of modules to begin with names the module pec\.classifier"):
        code_version(*EPISODES, root=tree)


def test_an_import_of_a_module_that_is_not_there_is_an_error(tree):
    (tree / "grasping/geometry/slabs.py").unlink()
    with pytest.raises(CodeVersionError, match=r"names the module grasping\.geometry\.slabs"):
        code_version(*EPISODES, root=tree)
