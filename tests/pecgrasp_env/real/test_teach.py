"""A class from the thing itself: what is shown is learnt, what cannot be is refused before anything moves."""

import json
import shutil
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pec import Classifier
from pec.training import fit
from pecgrasp.cli import main
from pecgrasp_env.policy.viewpoints import look_at, postures_around
from pecgrasp_env.real import ConnectionLost
from pecgrasp_env.real.camera.recorded import RecordedCamera, read_depth_image, write_depth_image
from pecgrasp_env.real.learning import read_clouds
from pecgrasp_env.real.teach import LEAST_VIEWS, TeachError, check_name, images_of, shown_in_image, teach
from pecgrasp_env.robot.kinematics import T_TOOL0_CAMERA, forward_kinematics
from tests.pecgrasp_env.real.drawn_table import table_with

N_POINTS = 64
PLACE = np.array([0.5, 0.0, 0.0])


def images(things, count=16):
    for k in range(count):
        turn, lean = 2.4 * k, 0.3 + 0.4 * (k % 4) / 4
        eye = PLACE + 0.5 * np.array([np.sin(lean) * np.cos(turn), 0.6 * np.sin(turn), np.cos(lean)])
        yield table_with(things, look_at(tuple(eye), tuple(PLACE)))


CAN = (0.5, 0.0, 0.033, 0.08)


def shown(things, count=16):
    return (shown_in_image(image, N_POINTS) for image in images(things, count))


def run(*overrides):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", ["pecgrasp", "teach", *overrides])
        main()


def test_what_was_shown_is_known_and_the_old_classifier_stays_as_it_was(checkpoint):
    classifier = Classifier.load(checkpoint)
    lesson = teach(classifier, "can", shown([CAN]))
    assert classifier.classes == ["ball", "rod"]
    assert lesson.classifier.classes == ["ball", "rod", "can"]
    assert len(lesson.clouds) >= 14
    fresh = [each.cloud for each in shown([(0.47, 0.06, 0.033, 0.08)], 7) if each.cloud is not None]
    assert np.mean([answer.label == "can" for answer in lesson.classifier.predict(fresh)]) >= 0.8
    right, n = lesson.recognised
    assert n >= 7
    assert right >= 0.7 * n
    assert sum(lesson.before.values()) == len(lesson.clouds)


@pytest.mark.parametrize(
    ("things", "words"),
    [
        ([], "3 × nothing on the table in the first 3 views: put the can on the table, alone"),
        ([CAN, (0.42, 0.09, 0.03, 0.06)], "3 × two things or more in the first 3 views"),
    ],
)
def test_nothing_and_two_things_are_told_after_three_views(things, words, checkpoint):
    views = shown(things)
    with pytest.raises(TeachError, match=words):
        teach(Classifier.load(checkpoint), "can", views)
    assert len(list(views)) == 13


def test_too_few_views_say_how_many_and_why_the_others_do_not_count(checkpoint):
    views = [*shown([CAN], LEAST_VIEWS - 2), *shown([], 3)]
    with pytest.raises(
        TeachError, match=rf"{LEAST_VIEWS - 2} views show one thing alone, {LEAST_VIEWS} are needed \(3"
    ):
        teach(Classifier.load(checkpoint), "can", views)


def test_what_lies_elsewhere_than_in_the_other_views_of_a_lay_does_not_count(checkpoint):
    views = [replace(each, place=np.zeros(3)) for each in shown([CAN], 9)]
    views += [replace(each, place=np.array([0.2, 0.0, 0.0]), lay=1) for each in shown([CAN], 5)]
    views[2] = replace(views[2], place=np.array([0.1, 0.0, 0.0]))
    lesson = teach(Classifier.load(checkpoint), "can", views)
    assert len(lesson.clouds) == 13
    assert lesson.left_out == {"another place than in the other views": 1}


def test_a_name_that_is_there_already_is_refused_before_anything_is_looked_at(checkpoint):
    views = shown([CAN])
    with pytest.raises(ValueError, match="there is a class 'rod' already"):
        teach(Classifier.load(checkpoint), "rod", views)
    assert len(list(views)) == 16
    with pytest.raises(ValueError, match="cannot be called"):
        check_name(Classifier.load(checkpoint), "unknown")


def test_the_command_learns_from_a_folder_of_frames(checkpoint, tmp_path, capsys):
    (tmp_path / "frames").mkdir()
    for k, image in enumerate(images([CAN])):
        write_depth_image(tmp_path / "frames" / f"{k:02}.npz", image)
    frames = ["views=frames", "camera=recorded", f"camera.folder={tmp_path}/frames", f"checkpoint={checkpoint}"]
    run("name=can", *frames, f"output={tmp_path}/out")
    assert "out/checkpoint knows ball, rod, can" in capsys.readouterr().out
    results = json.loads((tmp_path / "out" / "results.json").read_text())
    assert results["classes"] == Classifier.load(tmp_path / "out" / "checkpoint").classes == ["ball", "rod", "can"]
    assert results["views"] + sum(results["left_out"].values()) == 16
    with pytest.raises(SystemExit, match="holds a checkpoint already"):
        run("name=can", *frames, f"output={tmp_path}/out")
    with pytest.raises(SystemExit, match=r"views=arm.*host=…|host=… must be given"):
        run("name=can", f"checkpoint={checkpoint}", "camera=recorded", f"camera.folder={tmp_path}/frames")


BOX = (0.5, 0.0, 0.05, 0.02)


def taught(name, thing, folder, *overrides):
    (folder / "frames").mkdir(parents=True)
    for k, image in enumerate(images([thing], 12)):
        write_depth_image(folder / "frames" / f"{k:02}.npz", image)
    frames = ["views=frames", "camera=recorded", f"camera.folder={folder}/frames"]
    run(f"name={name}", *frames, f"output={folder}/out", *overrides)
    return folder / "out"


@pytest.mark.slow
def test_what_is_taught_one_after_another_is_known_as_if_taught_at_once(checkpoint, tmp_path):
    first = taught("can", CAN, tmp_path / "1", f"checkpoint={checkpoint}")
    second = taught("puck", BOX, tmp_path / "2", f"checkpoint={first}/checkpoint")
    training_run = Path(checkpoint).parent
    together = fit(training_run, {"can": read_clouds(first), "puck": read_clouds(second)})
    fresh = [each.cloud for thing in (CAN, BOX) for each in shown([thing], 4)]
    assert Classifier.load(second / "checkpoint").predict(fresh) == together.predict(fresh)
    learnt_with = json.loads((second / "results.json").read_text())["learnt_with"]
    assert learnt_with == {"run": str(training_run), "taught": {"can": str(first)}}


def test_a_checkpoint_that_left_its_run_is_shown_the_views_alone_or_told_where_the_run_is(checkpoint, tmp_path, capsys):
    alone = tmp_path / "alone"
    shutil.copytree(checkpoint, alone)
    out = taught("can", CAN, tmp_path / "1", f"checkpoint={alone}")
    said = capsys.readouterr().out
    assert "the views alone are learnt" in said
    assert "run=… says where that is" in said
    clouds = read_clouds(out)
    enrolled = Classifier.load(alone).enrol("can", clouds)
    assert Classifier.load(out / "checkpoint").predict(clouds) == enrolled.predict(clouds)
    told = taught("can", CAN, tmp_path / "2", f"checkpoint={alone}", f"run={Path(checkpoint).parent}")
    assert "learnt_with" in json.loads((told / "results.json").read_text())
    with pytest.raises(SystemExit, match="holds no finished training run"):
        taught("can", CAN, tmp_path / "3", f"checkpoint={alone}", f"run={tmp_path}")
    with pytest.raises(SystemExit, match="knows ball, rod, can; the run ball, rod"):
        taught("puck", BOX, tmp_path / "4", f"checkpoint={out}/checkpoint", f"run={Path(checkpoint).parent}")


def test_turned_by_hand_it_asks_before_each_view_and_keeps_the_frames(checkpoint, tmp_path, monkeypatch):
    (tmp_path / "frames").mkdir()
    for k, image in enumerate(images([CAN])):
        write_depth_image(tmp_path / "frames" / f"{k:02}.npz", image)
    questions = []
    monkeypatch.setattr("builtins.input", lambda words: questions.append(words) or ("y" if len(questions) < 11 else ""))
    shared = ["camera=recorded", f"camera.folder={tmp_path}/frames", f"checkpoint={checkpoint}"]
    run("name=can", "views=manual", *shared, f"output={tmp_path}/out")
    assert len(questions) == 11
    kept = sorted((tmp_path / "out" / "frames").glob("*.npz"))
    assert len(kept) == 10
    first = next(images([CAN]))
    np.testing.assert_allclose(read_depth_image(kept[0]).depth, first.depth, atol=6e-5)


def test_a_recorded_camera_ends_with_its_last_frame(tmp_path):
    for k, image in enumerate(images([CAN], 3)):
        write_depth_image(tmp_path / f"{k}.npz", image)
    camera = RecordedCamera(tmp_path)
    assert len(list(images_of(camera))) == 3
    with pytest.raises(ConnectionLost):
        camera.grab()


def test_views_around_a_place_look_at_it_from_many_sides():
    postures = postures_around(PLACE, 24)
    assert len(postures) == 24
    axes = []
    for q in postures:
        T = forward_kinematics(q) @ T_TOOL0_CAMERA
        towards = (PLACE - T[:3, 3]) / np.linalg.norm(PLACE - T[:3, 3])
        assert towards @ T[:3, 2] > 1 - 1e-9
        axes.append(towards)
    between = np.arccos(np.clip(np.array(axes) @ np.array(axes).T, -1, 1))
    assert np.rad2deg(between).max() > 60
    assert np.rad2deg(between[np.triu_indices(24, 1)]).min() > 3
