"""`pecgrasp teach` from its settings: plain values in, a folder with frames, clouds and the new checkpoint out."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

from pecgrasp_env.motion.trajectory import JOINT_SPEED
from pecgrasp_env.real.camera.recorded import write_depth_image
from pecgrasp_env.real.connected import Agreement, SettingError, connected, mount_of_setting, workspace_of
from pecgrasp_env.real.interfaces import DepthCamera
from pecgrasp_env.real.learning import FEWEST, RESULTS, Origin, origin_of, write_clouds
from pecgrasp_env.real.look_around import look_around
from pecgrasp_env.real.pick_record import write_frame
from pecgrasp_env.real.sight import Sight
from pecgrasp_env.real.teach import Lesson, Shown, check_name, images_of, shown_in_image, shown_in_view, teach
from pecgrasp_env.real.ur_measured import words_of

Say = Callable[[str], None]
VIEWS = ("arm", "manual", "frames")


def run_teach(
    settings: dict[str, Any], camera: DepthCamera, classifier: Any, ask: Callable[[str], bool], say: Say
) -> Lesson:
    """Show it, and keep what was learnt in `output`: frames/, clouds.npz, checkpoint/ and results.json.

    settings: those of conf/teach.yaml. ask: whether to go on, in words. Raises RobotError, ValueError, MountError.
    """
    name = str(settings["name"])
    if settings["views"] not in VIEWS:
        raise SettingError(f"views={settings['views']}: must be one of {', '.join(VIEWS)}")
    if settings["views"] == "arm" and settings["host"] is None:
        raise SettingError(
            "host=… must be given: the arm's controller; or views=manual, and the thing is turned by hand"
        )
    check_name(classifier, name)
    output = Path(settings["output"])
    if (output / "checkpoint").exists():
        raise SettingError(f"output={output}: holds a checkpoint already: name another folder, or take it away")
    run = None if settings["run"] is None else Path(settings["run"])
    origin = origin_of(Path(settings["checkpoint"]), run, classifier.classes)
    (output / "frames").mkdir(parents=True, exist_ok=True)
    by = {"arm": _by_arm, "manual": _by_hand, "frames": _by_frames}[settings["views"]]

    def learn(name: str, clouds: list[Any]) -> Any:
        nonlocal origin
        write_clouds(output, clouds)
        if isinstance(origin, Origin) and len(clouds) < FEWEST:
            origin = f"{len(clouds)} views, and training goes on with {FEWEST} at least"
        if isinstance(origin, str):
            say(f"the views alone are learnt, which tells less apart and costs what is known: {origin}")
            return classifier.enrol(name, clouds)
        say(f"learning them together with the clouds of {origin.run}, which takes some minutes")
        return origin.learn(name, clouds)

    views = _said(by(settings, camera, classifier.n_points, ask, say), say)
    lesson = teach(classifier, name, views, settings["least"], learn)
    lesson.classifier.save(output / "checkpoint")
    results: dict[str, Any] = {
        "name": name,
        "checkpoint": str(output / "checkpoint"),
        "classes": lesson.classifier.classes,
        "views": len(lesson.clouds),
        "left_out": lesson.left_out,
        "before": lesson.before,
        "recognised": list(lesson.recognised),
        "seconds": round(lesson.seconds, 1),
    }
    if isinstance(origin, Origin):
        results["learnt_with"] = origin.as_json()
    (output / RESULTS).write_text(json.dumps(results, indent=1) + "\n")
    for line in lines_of(lesson, name):
        say(line)
    say(f"{output}/checkpoint knows {', '.join(lesson.classifier.classes)}; learnt in {lesson.seconds:.0f} s")
    return lesson


def lines_of(lesson: Lesson, name: str) -> list[str]:
    """What came of it, for people."""
    lines = [f"{len(lesson.clouds)} views of the {name}"]
    lines += [f"left out: {count} views, {why}" for why, count in lesson.left_out.items()]
    taken = ", ".join(f"{label} {count}" for label, count in sorted(lesson.before.items(), key=lambda item: -item[1]))
    lines.append(f"before, it was taken for: {taken}")
    right, n = lesson.recognised
    lines.append(f"from half of the views, {right} of the other {n} are called {name}")
    if 2 * right < n:
        lines.append("that is few: show it from more sides, or it is too much like another class")
    return lines


def _said(views: Iterator[Shown], say: Say) -> Iterator[Shown]:
    for number, shown in enumerate(views, start=1):
        say(f"view {number}: {shown.why or f'{len(shown.cloud)} points'}")  # type: ignore[arg-type]
        yield shown


def _by_arm(
    settings: dict[str, Any], camera: DepthCamera, n_points: int, ask: Callable[[str], bool], say: Say
) -> Iterator[Shown]:
    """As often as `lays` says it is looked at from around; in between somebody lays it on another side."""
    mount = mount_of_setting(settings["calibration"])
    if mount.parent == "base":
        raise SettingError("the camera stands beside the robot: views=manual, and the thing is turned by hand")
    agreement, workspace = Agreement(settings["confirm"], ask), workspace_of(settings["workspace"])
    frames = _numbered(Path(settings["output"]))
    lays = int(settings["lays"])
    with connected(settings, JOINT_SPEED * settings["speed"]) as (arm, gripper):
        say(words_of(arm.lengths))
        sight = Sight(arm, gripper, camera, mount, lambda seen, frame: write_frame(next(frames), seen, frame))
        for lay in range(lays):
            if lay and not ask(f"lay the {settings['name']} on another side, then go on"):
                return
            count = settings["count"] // lays + (lay < settings["count"] % lays)
            for view in look_around(arm, sight, workspace, count, mount.T, agreement.agrees):
                yield replace(shown_in_view(view, n_points), lay=lay)


def _by_hand(
    settings: dict[str, Any], camera: DepthCamera, n_points: int, ask: Callable[[str], bool], say: Say
) -> Iterator[Shown]:
    frames = _numbered(Path(settings["output"]))
    for number in range(1, settings["count"] + 1):
        if not ask(
            f"view {number} of {settings['count']}: turn the {settings['name']}, take your hand away, then go on"
        ):
            return
        image = camera.grab()
        write_depth_image(next(frames), image)
        yield shown_in_image(image, n_points)


def _by_frames(
    settings: dict[str, Any], camera: DepthCamera, n_points: int, ask: Callable[[str], bool], say: Say
) -> Iterator[Shown]:
    """All that a folder or a bag holds; it is not copied."""
    for image in images_of(camera):
        yield shown_in_image(image, n_points)


def _numbered(output: Path) -> Iterator[Path]:
    number = 0
    while True:
        yield output / "frames" / f"{number:03}.npz"
        number += 1
