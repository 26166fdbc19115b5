"""Jobs over processes: every result once, one worker a process, nothing left behind."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from concurrent.futures.process import BrokenProcessPool
from contextlib import closing
from functools import partial
from pathlib import Path

import pytest

from pecgrasp_env.common.render_pool import run_jobs

ROOT = Path(__file__).parents[3]


class Recorder:
    """Notes in a folder that it was made, what it does, and that it was closed."""

    def __init__(self, folder: Path, pause_s: float = 0.0) -> None:
        self._folder, self._pause_s = folder, pause_s
        (folder / f"made.{os.getpid()}").touch()

    def run(self, job: int) -> tuple[int, int]:
        (self._folder / f"begun.{job}").touch()
        time.sleep(self._pause_s)
        if job < 0:
            raise ValueError(f"job {job}")
        if job == 1000:
            os.kill(os.getpid(), signal.SIGKILL)
        return job, os.getpid()

    def close(self) -> None:
        (self._folder / "closed").touch()


def ten_of(job: int) -> int:
    return job // 10


def count(folder: Path, pattern: str) -> int:
    return len(list(folder.glob(pattern)))


def test_one_worker_stays_in_this_process_keeps_the_order_and_closes(tmp_path):
    results = list(run_jobs(partial(Recorder, tmp_path), [3, 1, 2], 1))
    assert results == [(job, os.getpid()) for job in (3, 1, 2)]
    assert count(tmp_path, "made.*") == 1
    assert (tmp_path / "closed").exists()


def test_no_job_makes_no_worker(tmp_path):
    assert list(run_jobs(partial(Recorder, tmp_path), [], 2)) == []
    assert count(tmp_path, "made.*") == 0


@pytest.mark.parametrize("n_jobs", [2, 3, 9])
def test_several_processes_do_every_job_once_with_one_worker_each(tmp_path, n_jobs):
    results = list(run_jobs(partial(Recorder, tmp_path), range(n_jobs), 2))
    assert sorted(job for job, _ in results) == list(range(n_jobs))
    processes = {process for _, process in results}
    assert os.getpid() not in processes
    assert count(tmp_path, "made.*") == 2


def test_a_group_stays_in_one_process_until_the_other_is_out_of_work(tmp_path):
    jobs = [*range(10, 16), *range(20, 26)]
    done = dict(run_jobs(partial(Recorder, tmp_path, 0.05), jobs, 2, same_process=ten_of))
    assert sorted(done) == jobs
    # One process may be up late and lose half of its group to the other; the first job of each group it never does.
    assert done[10] == done[11]
    assert done[20] == done[21]
    assert done[10] != done[20]


def test_what_a_job_raises_comes_out_and_cancels_the_rest(tmp_path):
    with pytest.raises(ValueError, match="job -1"):
        list(run_jobs(partial(Recorder, tmp_path, 0.2), [-1, *range(40)], 2))
    assert count(tmp_path, "begun.*") < 41


@pytest.mark.parametrize("workers", [1, 2])
def test_a_worker_that_cannot_be_made_says_why(tmp_path, workers):
    with pytest.raises(FileNotFoundError, match="nowhere"):
        list(run_jobs(partial(Recorder, tmp_path / "nowhere"), range(4), workers))


def test_closing_cancels_what_has_not_begun(tmp_path):
    with closing(run_jobs(partial(Recorder, tmp_path), range(40), 2)) as results:
        next(results)
    assert count(tmp_path, "begun.*") <= 5  # done, and two each on their way


def test_a_killed_process_is_an_error_not_a_wait_for_ever(tmp_path):
    with pytest.raises(BrokenProcessPool):
        list(run_jobs(partial(Recorder, tmp_path), [0, 1000, 1, 2], 2))


@pytest.mark.parametrize(
    ("handler", "jobs", "printed"),
    [
        ("default_int_handler", "range(-600, -592)", "interrupted\n"),
        ("SIG_IGN", "range(4)", "[0, 1, 2, 3]\n"),  # in the background of a shell
    ],
)
def test_ctrl_c_ends_all_processes_at_once_and_quietly_unless_it_is_ignored(tmp_path, handler, jobs, printed):
    script = tmp_path / "long.py"
    script.write_text(
        "import signal, sys, time\n"
        "from pathlib import Path\n"
        "from pecgrasp_env.common.render_pool import run_jobs\n"
        "class Sleeper:\n"
        "    def run(self, job):\n"
        "        Path(sys.argv[1], f'begun.{job}').touch()\n"
        "        time.sleep(600 if job < 0 else 0.5)\n"
        "        return job\n"
        "    def close(self): pass\n"
        "if __name__ == '__main__':\n"
        f"    signal.signal(signal.SIGINT, signal.{handler})\n"
        "    try:\n"
        f"        print(sorted(run_jobs(Sleeper, {jobs}, 2)))\n"
        "    except KeyboardInterrupt:\n"
        "        print('interrupted')\n"
    )
    process = subprocess.Popen(
        [sys.executable, str(script), str(tmp_path)],
        cwd=ROOT,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    while count(tmp_path, "begun.*") < 2:
        assert process.poll() is None
        time.sleep(0.02)
    os.killpg(process.pid, signal.SIGINT)  # as a terminal does
    out, err = process.communicate(timeout=120)
    assert (out, err) == (printed, "")
