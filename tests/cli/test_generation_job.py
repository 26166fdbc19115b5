"""How a command that generates data ends where it cannot go on."""

import pytest
from omegaconf import OmegaConf

from pecgrasp.generation_job import generation_job
from pecgrasp_env.capture.config import CaptureError
from pecgrasp_env.common.job_share import JobShare


def settings(**more):
    return OmegaConf.create({"workers": 3, "shard": None, "progress": False, "out": "clouds", **more})


def test_the_call_gets_what_the_settings_say():
    with generation_job(settings(shard="1/4"), "generate", "cloud") as job:
        job["progress"](1, 2)
    assert job["workers"] == 3
    assert job["share"] == JobShare.parse("1/4")


def test_what_a_user_can_mend_is_said_in_a_line():
    with (
        pytest.raises(SystemExit, match=r"^pecgrasp generate-scenes: no such object$"),
        generation_job(settings(), "generate-scenes", "frame"),
    ):
        raise CaptureError("no such object")
    with (
        pytest.raises(SystemExit, match=r"^pecgrasp generate: .*4/4"),
        generation_job(settings(shard="4/4"), "generate", "cloud"),
    ):
        pass


def test_after_ctrl_c_it_is_said_where_what_is_there_lies(capsys):
    with pytest.raises(SystemExit) as ended, generation_job(settings(), "generate", "cloud"):
        raise KeyboardInterrupt
    assert ended.value.code == 130
    assert "lies in clouds, and the same command goes on" in capsys.readouterr().err


def test_a_fault_of_ours_is_not_hidden():
    with pytest.raises(ZeroDivisionError), generation_job(settings(), "generate", "cloud"):
        raise ZeroDivisionError
