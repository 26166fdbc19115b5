"""Episodes through the sockets are those of the simulation: the same scenes, judged by the same task."""

import ctypes
import gc
from dataclasses import replace

import pytest

pytest.importorskip("rtde_control", reason="pip install 'pecgrasp[ur]'")

from grasping import ROBOTIQ_2F_140, CurvaturePlanner
from pecgrasp_env.evaluation.run import EvaluationError, Protocol, run_episodes
from pecgrasp_env.evaluation.sockets import SocketRunner

ENV = {"n_objects": 1, "classes": ["plug_adapter"], "objects": {"seed": 1000}}
PLANNER = {"_target_": "grasping.CurvaturePlanner"}
MEMORY_MIB = 0.6  # what ten picks may add; one frame of each of them would be 3.9
_MIB = 2**20


class _MallocInfo(ctypes.Structure):
    """What glibc's mallinfo2 tells, bytes."""

    _NAMES = "arena ordblks smblks hblks hblkhd usmblks fsmblks uordblks fordblks keepcost"
    _fields_ = [(name, ctypes.c_size_t) for name in _NAMES.split()]


@pytest.fixture
def heap_mib():
    """A function that tells the heap in use of this process, MiB, in all arenas and mapped, while nothing searches for
    cycles: what waits for that search counts as grown.
    """
    mallinfo = getattr(ctypes.CDLL(None), "mallinfo2", None)
    if mallinfo is None:
        pytest.skip("glibc 2.33 or newer tells the heap in use")
    mallinfo.restype = _MallocInfo

    def in_use():
        told = mallinfo()
        return (told.uordblks + told.hblkhd) / _MIB

    gc.disable()
    yield in_use
    gc.enable()


def too_narrow():
    """A planner whose hand opens too little for anything."""
    return CurvaturePlanner(replace(ROBOTIQ_2F_140, stroke=0.025))


@pytest.mark.slow
def test_the_same_seed_is_the_same_scene_and_is_lifted_alike(tmp_path):
    seeds = [700_003, 700_004]
    simulated = run_episodes(Protocol(ENV, None, PLANNER, {}), seeds, tmp_path / "simulation")
    driven = run_episodes(Protocol(ENV, None, PLANNER, {}, sockets=8), seeds, tmp_path / "sockets", pictures=True)
    for one, other in zip(simulated, driven, strict=True):
        assert (one.seed, one.target, one.objects) == (other.seed, other.target, other.objects)
        assert one.visible_share == pytest.approx(other.visible_share)
        assert (one.outcome, other.outcome) == ("success", "success")
        assert other.steps == pytest.approx(one.steps, rel=0.2)
        assert set(other.stages) == set(one.stages)
    assert list((tmp_path / "sockets" / "failures").iterdir()) == []


@pytest.mark.slow
def test_an_episode_has_as_many_steps_as_the_environment(tmp_path):
    protocol = Protocol(ENV | {"max_episode_steps": 40}, None, PLANNER, {}, sockets=8)
    (episode,) = run_episodes(protocol, [700_003], tmp_path)
    assert episode.outcome == "timeout"
    assert 40 <= episode.steps <= 41


@pytest.mark.slow
def test_a_pick_that_failed_leaves_its_frames_and_a_page(tmp_path):
    protocol = Protocol(ENV, None, {"_target_": f"{__name__}.too_narrow"}, {"attempts": 1}, sockets=8)
    (episode,) = run_episodes(protocol, [700_003], tmp_path, pictures=True)
    assert episode.outcome == "no_grasp"
    assert episode.reason.startswith("no grasp")
    folder = tmp_path / "failures" / "700003"
    assert {"pick.html", "outcome.json", "steps.jsonl", "frames"} <= {each.name for each in folder.iterdir()}


@pytest.mark.slow
def test_picks_one_after_the_other_keep_nothing(heap_mib, tmp_path):
    runner = SocketRunner(Protocol(ENV, None, PLANNER, {}).make_policy(), ENV, 20, tmp_path)
    try:
        held = []
        for seed in range(710_000, 710_014):
            assert runner.run(seed).outcome in {"success", "missed", "no_grasp"}
            held.append(heap_mib())
    finally:
        runner.close()
    # Each pick leaves its last objects until the next one begins: the least of some is what stays.
    assert min(held[-4:]) - min(held[:4]) < MEMORY_MIB


@pytest.mark.parametrize(
    ("env", "sockets", "words"),
    [({"absent": True}, 4, "no real arm says"), ({}, 0, "sockets=0: a pace"), ({}, -1, "sockets=-1")],
)
def test_what_no_arm_can_do_is_refused(env, sockets, words, tmp_path):
    with pytest.raises(EvaluationError, match=words):
        run_episodes(Protocol(env, None, PLANNER, {}, sockets=sockets), [1], tmp_path)
