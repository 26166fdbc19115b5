"""The command `pecgrasp` itself: its help, what it imports, what it says where a command or an extra is missing."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from hydra.core.override_parser.overrides_parser import OverridesParser

from pecgrasp.cli import COMMANDS, main
from pecgrasp.settings import file_as_override

ROOT = Path(__file__).parents[2]


def pecgrasp(*words: str, cwd: Path = ROOT) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-m", "pecgrasp", *words], cwd=cwd, capture_output=True, text=True)


@pytest.mark.parametrize("words", [[], ["--help"], ["-h"]])
def test_help_lists_every_command_on_one_screen(words, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["pecgrasp", *words])
    main()
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) <= 40
    assert max(map(len, lines)) <= 80
    assert [line.split()[0] for line in lines[1:]] == list(COMMANDS)


def test_help_imports_nothing_that_takes_time():
    program = (
        "import sys; from pecgrasp.cli import main; main(); "
        "print(sorted({'numpy', 'hydra', 'torch', 'sapien', 'grasping', 'pec', 'pecgrasp_env'} & set(sys.modules)))"
    )
    ended = subprocess.run([sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True)
    assert ended.stdout.splitlines()[-1] == "[]", ended.stderr


def test_each_command_has_its_module_and_each_script_its_command():
    modules = {path.stem for path in (ROOT / "pecgrasp/commands").glob("[!_]*.py")}
    assert modules == {name.replace("-", "_") for name in COMMANDS}
    scripts = {path.stem: path.read_text() for path in (ROOT / "scripts").glob("*.py")}
    called = {command for command in COMMANDS for text in scripts.values() if f'main("{command}")' in text}
    assert len(called) == len(scripts)
    assert set(COMMANDS) - called == {"segment", "doctor"}


def test_a_command_that_is_not_there_is_named(monkeypatch):
    monkeypatch.setattr(sys, "argv", ["pecgrasp", "pln", "cloud.ply"])
    with pytest.raises(SystemExit, match=r"pecgrasp: no command 'pln'; there are plan, segment, "):
        main()


@pytest.mark.parametrize(("command", "package"), [("train", "torch"), ("generate", "sapien"), ("export-onnx", "onnx")])
def test_a_missing_extra_is_one_line_that_says_what_to_install(command, package, monkeypatch):
    extra = COMMANDS[command][0]
    monkeypatch.setitem(sys.modules, package, None)
    monkeypatch.setattr(sys, "argv", ["pecgrasp", command])
    with pytest.raises(SystemExit, match=rf"pecgrasp {command} needs pip install 'pecgrasp\[{extra}\]' .*{package}"):
        main()


@pytest.mark.parametrize(
    "name", ["box.ply", "a b/c (1), [x].npy", 'the "best".npy', "it's.npy", "C:\\a\\b.ply", r"q\".npy"]
)
def test_a_file_named_first_is_the_cloud_whatever_is_in_its_name(name):
    words = file_as_override([name, "frame=world"])
    override = OverridesParser.create().parse_override(words[0])
    assert (override.key_or_group, override.value()) == ("cloud", name)
    assert words[1:] == ["frame=world"]


@pytest.mark.parametrize("words", [[], ["cloud=x.npy"], ["--config-dir", "own"], ["+segmenter.gap=0.01"], ["~up"]])
def test_overrides_and_flags_are_left_alone(words):
    assert file_as_override(words) == words


def test_a_config_folder_of_ones_own_adds_to_ours(tmp_path):
    (tmp_path / "own/gripper").mkdir(parents=True)
    text = (ROOT / "conf/gripper/panda_hand.yaml").read_text().replace("panda_hand\n", "my_hand\n", 1)
    (tmp_path / "own/gripper/mine.yaml").write_text(text)
    shown = pecgrasp("plan", "gripper=mine", "--config-dir", "own", "--cfg", "job", cwd=tmp_path)
    assert "name: my_hand" in shown.stdout, shown.stderr
    assert "_target_: grasping.CurvaturePlanner" in shown.stdout


def test_a_command_has_hydras_help_and_runs_from_any_folder(tmp_path):
    shown = pecgrasp("train", "--help", cwd=tmp_path)
    assert shown.returncode == 0
    assert "train is powered by Hydra" in shown.stdout
    assert "dataset: clouds, folder, generated" in shown.stdout
