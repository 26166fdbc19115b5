"""`pecgrasp plan` on files of every kind: its table, its exit status, results.json and plan.html."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from grasping_shapes import box_top
from hydra import compose, initialize_config_dir
from hydra.utils import instantiate
from mesh_shapes import box as block
from mesh_shapes import write_ply
from omegaconf import DictConfig
from rendered_scenes import BOXES, look_down, render
from scipy.spatial.transform import Rotation
from table_scenes import box, table_scene, task

import grasping
from grasping import ConfigError, CurvaturePlanner
from grasping.gripper import ROBOTIQ_2F_140
from grasping.plan_files.run import plan_files
from pec.grasps.checkpoint import GraspCheckpoint, write_grasp_checkpoint
from pec.grasps.network import NetworkConfig, build_network
from pecgrasp.commands.plan import task_of

ROOT = Path(__file__).parents[3]


def command(*arguments: str) -> subprocess.CompletedProcess[str]:
    words = [sys.executable, "-m", "pecgrasp", "plan", *arguments]
    return subprocess.run(words, cwd=ROOT, capture_output=True, text=True, timeout=120)


def configured(*overrides: str) -> DictConfig:
    with initialize_config_dir(str(ROOT / "conf"), version_base="1.3"):
        return compose("plan", overrides=["cloud=box.npy", *overrides])


@pytest.fixture(scope="module")
def folder_run(tmp_path_factory: pytest.TempPathFactory) -> tuple[subprocess.CompletedProcess[str], Path]:
    folder = tmp_path_factory.mktemp("clouds")
    np.save(folder / "box.npy", box())
    np.savetxt(folder / "wide.xyz", box_top(0.3, 0.25, 0.06, step=0.005))
    (folder / "broken.ply").write_text("ply\nformat ascii 1.0\nelement vertex 2\nproperty flat x\n")
    (folder / "notes.txt").write_text("no cloud")
    output = folder / "out"
    return command(f"cloud={folder}", "frame=world", f"output={output}"), output


def test_one_damaged_file_does_not_stop_the_others_and_the_exit_status_says_so(folder_run) -> None:
    ended, output = folder_run
    assert ended.returncode == 1
    assert "pecgrasp plan: 1 of 3 files failed" in ended.stderr
    rows = ended.stdout.splitlines()
    assert rows[0].split() == ["cloud", "points", "width", "score", "kind", "position", "m", "time"]
    assert rows[1].startswith("box.npy")
    assert "50 mm" in rows[1]
    assert "error: line 4: 'property flat x' is not understood" in rows[2]
    assert "no grasp: " in rows[3]
    assert "wide" in rows[3]
    results = json.loads((output / "results.json").read_text())
    assert results["summary"] == {"files": 3, "failed": 1, "objects": 2, "with_grasp": 1}


def test_results_hold_the_poses_as_the_planner_found_them(folder_run) -> None:
    _, output = folder_run
    results = json.loads((output / "results.json").read_text())
    assert results["gripper"]["stroke"] == 0.14
    assert results["up"] == [0.0, 0.0, 1.0]
    (found,) = results["files"][0]["objects"]
    plan = CurvaturePlanner().plan(box().astype(np.float32), up=(0, 0, 1))
    assert len(found["grasps"]) == len(plan.candidates)
    for told, grasp in zip(found["grasps"], plan.candidates, strict=True):
        np.testing.assert_allclose(told["pose"], grasp.pose, atol=1e-12)
        assert (told["width"], told["score"]) == (grasp.width, grasp.score)
        assert told["terms"] == dict(grasp.terms)
    assert [region["verdict"] for region in found["regions"]] == [region.verdict for region in plan.regions]
    (wide,) = results["files"][2]["objects"]
    assert wide["grasps"] == []
    assert wide["reason"]
    assert results["files"][1]["error"].startswith("line 4")


def test_the_page_stands_by_itself_and_names_every_file(folder_run, outline) -> None:
    _, output = folder_run
    seen = outline((output / "plan.html").read_text())
    assert all(address.startswith(("#", "data:")) for address in seen.addresses)
    assert {address[1:] for address in seen.addresses if address.startswith("#")} <= set(seen.ids)
    for name in ("box.npy", "broken.ply", "wide.xyz"):
        assert seen.text.count(name) >= 2
    assert len(seen.data) == 2
    assert not list(output.glob("*.tmp"))


def untrained(folder: Path, name: str) -> Path:
    """A checkpoint of a network for grasps with the weights that it begins with."""
    config = NetworkConfig(name)
    write_grasp_checkpoint(folder / name, GraspCheckpoint(build_network(config), config, epoch=0))
    return folder / name


@pytest.mark.parametrize("planner", sorted(path.stem for path in (ROOT / "conf" / "planner").glob("*.yaml")))
def test_every_configured_planner_plans_a_file_and_leaves_a_page(planner: str, tmp_path: Path, outline) -> None:
    write_ply(tmp_path / "block.ply", block(0.05, 0.12, 0.06))
    files = {
        "model": [f"planner.models={tmp_path}"],
        "gpd": [f"planner.scores.directory={untrained(tmp_path, 'gpd')}"],
        "pointnetgpd": [f"planner.scores.directory={untrained(tmp_path, 'pointnetgpd')}"],
        "rerank": [f"planner.rerank.directory={untrained(tmp_path, 'pointnetgpd')}"],
        "graspnet": [
            f"planner.scores.directory={untrained(tmp_path, 'graspnet_evaluator')}",
            f"planner.propose.sampler={untrained(tmp_path, 'graspnet_sampler')}",
        ],
    }.get(planner, [])
    own = instantiate(configured(f"planner={planner}", *files).planner, _partial_=True)(gripper=ROBOTIQ_2F_140)
    name = """a<b>&"quoted' box.npy"""
    np.save(tmp_path / name, box())
    plan_files([tmp_path / name], task(planner=own), tmp_path / "out", say=lambda line: None)
    (file,) = json.loads((tmp_path / "out/results.json").read_text())["files"]
    (found,) = file["objects"]
    assert bool(found["grasps"]) == (found["reason"] is None)
    assert found["error"] is None
    seen = outline((tmp_path / "out/plan.html").read_text())
    assert seen.text.count(name) >= 3


def test_a_gripper_of_ones_own_and_another_planner_are_taken(tmp_path: Path) -> None:
    np.save(tmp_path / "box.npy", box())
    own = (ROOT / "conf/gripper/panda_hand.yaml").read_text().replace("panda_hand\n", "my_hand\n", 1)
    (tmp_path / "mine.yaml").write_text(own.replace("stroke: 0.080", "stroke: 0.075"))
    ended = command(
        f"cloud={tmp_path}/box.npy",
        f"gripper={tmp_path}/mine.yaml",
        "planner=centroid",
        f"output={tmp_path}/out",
        "up=[0,0,1]",
    )
    assert ended.returncode == 0, ended.stderr
    results = json.loads((tmp_path / "out/results.json").read_text())
    assert (results["gripper"]["name"], results["gripper"]["stroke"]) == ("my_hand", 0.075)
    assert results["planner"] == "CentroidPlanner"
    assert "my_hand, opening up to 75 mm, planned by CentroidPlanner" in (tmp_path / "out/plan.html").read_text()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "Missing mandatory value: cloud"),
        (["cloud=nowhere.ply"], "cloud nowhere.ply does not exist"),
        (["cloud=README.md", "gripper=nowhere.yaml"], "gripper=nowhere.yaml: No such file or directory"),
    ],
)
def test_a_command_without_sense_ends_with_one_line(arguments: list[str], message: str, tmp_path: Path) -> None:
    ended = command(*arguments, f"output={tmp_path}")
    assert ended.returncode == 1
    assert message in ended.stderr
    assert ended.stderr.startswith("pecgrasp plan: ")
    assert len(ended.stderr.splitlines()) == 1


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("gripper.stroke=85", r"gripper\.stroke = 85\.0 is more than a metre"),
        ("+gripper.strok=0.085", r"gripper\.strok is not a field"),
        ("frame=moon", "frame = 'moon' must be camera or world"),
        ("up=z", "up = 'z' is not a vector"),
        ("scale=mm", "scale = 'mm' must be a positive number"),
        ("+planner.friction=-1", "friction = -1 must be between"),
        ("+planner.frictoin=1", "CurvaturePlanner: .*frictoin"),
        ("+segmenter.gap=-1", "gap = -1 must be between"),
    ],
)
def test_a_setting_without_sense_is_refused_by_name_and_value(override: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        task_of(configured("scene=true", override))


def test_a_gripper_file_that_is_no_yaml_is_named(tmp_path: Path) -> None:
    (tmp_path / "mine.yaml").write_text("stroke: [")
    with pytest.raises(ConfigError, match=r"gripper=.*mine\.yaml: expected the node content"):
        task_of(configured(f"gripper_file={tmp_path}/mine.yaml"))


def test_the_command_needs_neither_torch_nor_the_simulator() -> None:
    program = (
        "import sys; import pecgrasp.commands.plan; "
        "print(sorted({name.split('.')[0] for name in sys.modules} & {'torch', 'sapien', 'mani_skill', 'gymnasium'}))"
    )
    ended = subprocess.run([sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, timeout=60)
    assert ended.stdout.strip() == "[]", ended.stderr


def python_lines(page: str, number: int) -> str:
    """Of a page's blocks of Python, the one of this number."""
    return (ROOT / page).read_text().split("```python\n")[number].split("```")[0]


def test_the_readmes_composed_lines_run_as_they_stand(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    names: dict[str, Any] = {}
    exec(python_lines("README.md", 2), names)
    assert len(names["scene"].objects) == 4
    assert names["T_camera_grasp"].shape == (4, 4)


def test_the_lines_on_ones_own_robot_run_as_they_stand(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    lines = python_lines("docs/own_robot.md", 1)
    assert len([line for line in lines.splitlines() if line]) <= 10
    monkeypatch.chdir(tmp_path)
    points = table_scene().astype("<f4")
    header = f"VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nWIDTH {len(points)}\nHEIGHT 1\nDATA binary\n"
    Path("frame.pcd").write_bytes(header.encode() + points.tobytes())
    names = {"T_base_camera": np.diag([1.0, -1.0, -1.0, 1.0])}
    exec(lines, names)
    assert names["T_base_grasp"][2, 2] == pytest.approx(-1.0, abs=0.01)
    assert 0.04 < names["width"] < names["opening"] <= ROBOTIQ_2F_140.stroke


def test_the_lines_on_several_views_run_as_they_stand() -> None:
    views = [turned(angle, look_down(35.0)) for angle in (0.0, 60.0, -60.0)]
    names = {
        "frames": [render(BOXES, T_world_camera, 0.001, seed)[0] for seed, T_world_camera in enumerate(views)],
        "T_base_cameras": views,
        **{name: getattr(grasping, name) for name in ("ROBOTIQ_2F_140", "CurvaturePlanner", "Segmenter")},
        "np": np,
    }
    exec(python_lines("docs/own_robot.md", 2), names)
    assert names["fused"].kept == [0, 1, 2]
    assert len(names["rest"]) == len(BOXES) - 1
    pose = views[0] @ names["plan"].best.pose
    assert min(np.hypot(*(pose[:2, 3] - box[:2])) for box in BOXES) < 0.01
    assert pose[2, 2] < -0.98


def turned(angle: float, T: np.ndarray) -> np.ndarray:
    """A camera's pose, turned about the world's z by so many degrees."""
    about_z = np.eye(4)
    about_z[:3, :3] = Rotation.from_euler("z", angle, degrees=True).as_matrix()
    return about_z @ T
