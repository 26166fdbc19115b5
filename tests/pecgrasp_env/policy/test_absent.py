"""What is not there, and what is of no class: the policy says so after it has looked, and touches nothing."""

import gymnasium as gym
import numpy as np
import pytest
import trimesh

import pec.classifier
import pecgrasp_env.objects.strangers
from grasping import Segmenter
from pec.classifier import Prediction
from pecgrasp_env import ScriptedPolicy
from pecgrasp_env.evaluation.run import run_episode
from pecgrasp_env.objects import LARS_CLASSES, Catalogue
from pecgrasp_env.policy.log import PolicyLog
from pecgrasp_env.policy.pick_planner import PickPlanner
from pecgrasp_env.policy.seen_objects import UNKNOWN, SeenObject, class_probabilities


@pytest.fixture(scope="module")
def env(tmp_path_factory):
    folder = tmp_path_factory.mktemp("strangers")
    trimesh.creation.box((0.07, 0.04, 0.03)).export(folder / "brick.ply")
    trimesh.creation.cylinder(0.02, 0.08).export(folder / "peg.ply")
    environment = gym.make(
        "SelectiveGrasp-v1",
        obs_mode="depth",
        control_mode="pd_joint_pos",
        sim_backend="physx_cpu",
        render_backend="cpu",
        objects=Catalogue(LARS_CLASSES, instances_per_class=2),
        n_objects=2,
        n_strangers=1,
        strangers=folder,
        absent=0.5,
    )
    yield environment
    environment.close()


class Knows:
    """As `labels`, with a score of being known: ``known`` of what is of a class, and ``strange`` of what is not."""

    n_points = 1

    def __init__(self, truth, known=0.97, strange=0.03):
        self.truth, self.known, self.strange = truth, known, strange

    def predict(self, clouds):
        names = [self.truth(cloud)[0] for cloud in clouds]
        # A stranger is taken for the class that is asked for, were it one.
        target = self.truth.task.target_names[0]
        return [
            Prediction(name, 0.99, {target if name == UNKNOWN else name: 0.99, "none": 0.01}, self.of(name))
            for name in names
        ]

    def of(self, name):
        return self.strange if name == UNKNOWN else self.known


def seed_of(env, absent):
    return next(seed for seed in range(20) if bool(env.reset(seed=seed)[1]["absent"]) == absent)


@pytest.mark.parametrize("knows", [True, False])
@pytest.mark.parametrize(("absent", "outcome"), [(True, "absent"), (False, "success")])
def test_it_lifts_what_is_there_and_says_what_is_not(env, labels, knows, absent, outcome):
    truth = labels(env)
    policy = ScriptedPolicy(Knows(truth) if knows else truth, answers=True)
    seed = seed_of(env, absent)
    episode = run_episode(env, policy, seed)
    assert episode.outcome == outcome
    assert policy.log.absent == absent
    assert (episode.visible_share is None) == absent
    if absent:
        assert episode.views == 4  # from each of its places, once
        assert (episode.reason, episode.failures) == ("not found", ["not found"])
        assert episode.disturbance_m == pytest.approx(0.0, abs=1e-3)


def test_a_wrong_no_ends_the_episode_as_a_failure(env, labels):
    policy = ScriptedPolicy(labels(env, dict.fromkeys(LARS_CLASSES, UNKNOWN)), answers=True)
    assert run_episode(env, policy, seed_of(env, False)).outcome == "denied"


def test_a_stranger_that_is_taken_for_the_class_is_counted_as_one(env, labels):
    seed = seed_of(env, True)
    policy = ScriptedPolicy(Knows(labels(env), strange=0.999), answers=True)
    assert run_episode(env, policy, seed).outcome == "stranger"


def test_in_doubt_it_looks_again_before_it_touches(env, labels):
    seed = seed_of(env, False)
    sure = run_episode(env, ScriptedPolicy(Knows(labels(env)), answers=True), seed)
    unsure = run_episode(env, ScriptedPolicy(Knows(labels(env), known=0.8), answers=True), seed)
    assert (sure.outcome, unsure.outcome) == ("success", "success")
    assert sure.views == 1
    assert unsure.views > 1


@pytest.mark.slow
def test_what_the_classifier_would_not_call_known_is_not_touched(env, labels):
    classifier = Knows(labels(env), known=0.85)
    classifier.unknown_below = 0.9
    episode = run_episode(env, ScriptedPolicy(classifier, answers=True, attempts=1), seed_of(env, False))
    assert (episode.outcome, episode.views) == ("denied", 4)
    classifier.unknown_below = 0.8
    episode = run_episode(env, ScriptedPolicy(classifier, answers=True, attempts=1), seed_of(env, False))
    assert episode.outcome == "success"


def test_actions_carry_the_answer(env, labels):
    obs, info = env.reset(seed=seed_of(env, True))
    policy = ScriptedPolicy(labels(env), answers=True)
    policy.reset(info["target"][0])
    actions = []
    while not policy.done:
        actions.append(policy.act(obs))
        obs, _, terminated, _, info = env.step(actions[-1])
    assert bool(terminated)
    assert {action.shape for action in actions} == {(9,)}
    assert [float(action[8]) for action in actions] == [-1.0] * (len(actions) - 1) + [1.0]


def test_being_of_no_class_is_averaged_over_views_and_classes_are_multiplied():
    def view(known):
        return {"mouse": 0.9 * known, "can": 0.1 * known, UNKNOWN: 1 - known}

    once = SeenObject(np.zeros((5, 3)), False, [view(0.6)]).probabilities()
    assert once == pytest.approx({"mouse": 0.54, "can": 0.06, UNKNOWN: 0.4})
    thrice = SeenObject(np.zeros((5, 3)), False, [view(0.6)] * 3).probabilities()
    assert thrice[UNKNOWN] == pytest.approx(0.4)
    assert thrice["mouse"] == pytest.approx(0.6 * 0.9**3 / (0.9**3 + 0.1**3))
    mixed = SeenObject(np.zeros((5, 3)), False, [view(0.9), view(0.1)]).probabilities()
    assert mixed[UNKNOWN] == pytest.approx(0.5)


def test_a_classifier_that_gives_its_confidence_for_known_is_not_asked_twice():
    class Older:
        n_points = 1

        def predict(self, clouds):
            return [Prediction("mouse", 0.8, {"mouse": 0.8, "can": 0.2}, 0.8) for _ in clouds]

    assert class_probabilities(Older(), [np.zeros((5, 3))]) == [{"mouse": 0.8, "can": 0.2}]


def test_what_lies_on_another_may_hide_what_is_asked_for():
    def slab(x, z, half, name):
        u = np.linspace(-half, half, 30)
        top = np.stack(np.meshgrid(u + x, u, [z]), axis=-1).reshape(-1, 3)
        return SeenObject(top, False, [{name: 0.99, "mouse": 0.01}])

    def planner(classifier):
        return PickPlanner(classifier, None, Segmenter(), 0.6, "mouse", PolicyLog())

    apart = [slab(0.4, 0.02, 0.05, "can"), slab(0.6, 0.06, 0.02, "box")]
    upon = [slab(0.4, 0.02, 0.05, "can"), slab(0.4, 0.06, 0.02, "box")]
    maybe = [slab(0.4, 0.02, 0.05, "can"), SeenObject(apart[1].points, False, [{"mouse": 0.3, "box": 0.7}])]
    assert planner(object()).is_absent(apart)
    assert not planner(object()).is_absent(upon)
    assert not planner(object()).is_absent(maybe)
    assert not planner(None).is_absent(apart)


def test_a_stranger_goes_by_one_name_everywhere():
    assert pec.classifier.UNKNOWN == pecgrasp_env.objects.strangers.UNKNOWN == UNKNOWN
