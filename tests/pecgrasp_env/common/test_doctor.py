"""The doctor's report on a machine that renders, and on one whose Vulkan driver is missing."""

import importlib.metadata

import pytest

from pecgrasp_env.common.doctor import main, render_trial


def test_it_reports_what_the_environment_stands_on_and_that_it_renders(capsys):
    assert main([]) == 0
    report = capsys.readouterr().out
    assert "Renders  yes" in report
    for package in ("mani-skill", "sapien", "torch"):
        assert f"{package} {importlib.metadata.version(package)}" in report
    assert {line.split()[0] for line in report.splitlines()} >= {"Python", "Packages", "Grasping", "Drivers", "GPU"}


def test_quiet_prints_nothing(capsys):
    assert main(["--quiet"]) == 0
    assert capsys.readouterr().out == ""


@pytest.fixture
def no_driver(monkeypatch, tmp_path):
    """The Vulkan loader finds no driver at all."""
    for name in ("VK_DRIVER_FILES", "VK_ICD_FILENAMES"):
        monkeypatch.setenv(name, str(tmp_path / "none.json"))


def test_without_a_driver_it_says_what_to_install(no_driver, capsys):
    assert main([]) == 1
    report = capsys.readouterr().out
    assert "Renders  NO: " in report
    assert "mesa-vulkan-drivers" in report
    assert main(["--quiet"]) == 1


def test_a_trial_that_hangs_is_ended():
    renders, why = render_trial(timeout=0.01)
    assert not renders
    assert "no picture within" in why


def test_an_unknown_argument_is_refused(capsys):
    assert main(["--loud"]) == 2
    assert "--loud" in capsys.readouterr().err
