"""The whole chain in one go: labelled clouds, a classifier trained on them, selective episodes, a film and a report.

Every part of the work has a folder below OUT/work whose name is a fingerprint of the settings that decide it. So a
second run with the same settings goes on where the first was stopped, and one with other settings starts afresh.
"""

from __future__ import annotations

import importlib.metadata
import json
import logging
import os
import platform
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import closing, contextmanager
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import Any

import imageio_ffmpeg  # type: ignore[import-untyped]
import numpy as np
from tqdm import tqdm

from pec.common.atomic_files import write_json
from pec.common.run_identity import settings_key
from pec.training.loop import train
from pecgrasp_env.capture import CaptureConfig, generate
from pecgrasp_env.common.render_pool import run_jobs
from pecgrasp_env.common.video import join_films
from pecgrasp_env.demo.episode_record import EpisodeRecord, load_record
from pecgrasp_env.demo.recorder import EpisodeRecorder
from pecgrasp_env.demo.report import ClassifierRecord, ReportRecord, stage_times, write_report
from pecgrasp_env.evaluation.run import Protocol
from pecgrasp_env.evaluation.summary import summarise, table

Say = Callable[[str], None]

_VERSIONS = ("pecgrasp", "mani-skill", "sapien", "torch", "gymnasium", "numpy", "scipy")


def run_demo(
    settings: Mapping[str, Any], configuration: str = "", command: str = "make demo", say: Say = print
) -> dict[str, Any]:
    """Run all of it, or what is left of it.

    settings: what conf/demo.yaml makes. configuration: the same as text, and command: what was typed, for the report.
    say: called with what happens, in words.
    Returns what is also written to OUT/results.json; OUT/report.html and OUT/video.mp4 lie beside it.
    """
    out = Path(settings["out"])
    generation, training, evaluation = settings["generation"], settings["training"], _evaluation(settings)
    clouds = _folder(out, "clouds", generation)
    run = _folder(out, "classifier", generation, training)
    episodes = _folder(out, "episodes", generation, training, evaluation, settings["film"])

    parts = {"clouds": clouds, "training": run, "episodes": episodes}

    config = CaptureConfig.from_settings(generation)
    say(f"[1/4] Labelled clouds: objects on the robot's table, seen and cut out as in the episodes → {clouds}")
    with _work_on(clouds), _cloud_bar() as progress:
        made = generate(config, clouds, workers=settings["workers"], progress=progress)
    say(f"      {made.n_samples:,} clouds, {made.n_new:,} of them new")

    say(f"[2/4] Training the classifier on them → {run}")
    with _work_on(run):
        trained = train({**training, "dataset": {**training["dataset"], "path": str(clouds)}, "output": str(run)})
    say(f"      {100 * trained['best']['test_accuracy']:.1f} % of {trained['n_samples']['test']:,} test clouds right")

    say(f"[3/4] {settings['episodes']} episodes: find and lift the object of the asked-for class → {episodes}")
    protocol = Protocol(evaluation["env"], str(run / "best"), evaluation["planner"], evaluation["policy"])
    seeds = range(settings["first_seed"], settings["first_seed"] + settings["episodes"])
    with _work_on(episodes):
        _record_episodes(protocol, seeds, episodes, settings["film"], settings["workers"], say)

    say("[4/4] Film and report")
    report, film = out / "report.html", out / "video.mp4"
    join_films([episodes / f"{seed}.mp4" for seed in seeds], film)
    records, begin = [], 0.0
    for seed in seeds:
        records.append(replace(load_record(episodes / f"{seed}.npz"), film_second=begin))
        begin += imageio_ffmpeg.count_frames_and_secs(str(episodes / f"{seed}.mp4"))[1]
    spent = {part: _work(folder)["seconds"] for part, folder in parts.items()}
    versions = _versions()
    write_report(
        report,
        ReportRecord(
            title="The asked-for object, out of several",
            introduction=_introduction(config, made.n_samples, evaluation["env"]),
            episodes=records,
            classifier=ClassifierRecord(
                trained["classes"], np.array(trained["best"]["test_confusion"]), _curves(run), _split_note(trained)
            ),
            durations=spent,
            configuration=configuration,
            versions=versions,
            commands=[command],
            film=film.name,
        ),
    )
    results = _results(trained, records, spent, versions) | {"report": str(report), "video": str(film)}
    write_json(out / "results.json", results)
    say(table(summarise([record.episode for record in records])))
    say("")
    say(f"report   {report.resolve()}")
    say(f"video    {film.resolve()}")
    say(f"results  {(out / 'results.json').resolve()}")
    return results


def _evaluation(settings: Mapping[str, Any]) -> dict[str, Any]:
    return {name: settings[name] for name in ("env", "planner", "policy")}


def _folder(out: Path, name: str, *decisive: Any) -> Path:
    """A folder below OUT/work that is the same for the same settings."""
    path = out / "work" / f"{name}-{settings_key(*decisive)}"
    path.mkdir(parents=True, exist_ok=True)
    return path


@contextmanager
def _work_on(folder: Path) -> Iterator[None]:
    """Adds the seconds that are spent here to what FOLDER/work.json has, until the work is finished."""
    path = folder / "work.json"
    before = _work(folder)
    begin = time.monotonic()
    finished = False
    try:
        yield
        finished = True
    finally:
        if not before["finished"]:
            seconds = round(before["seconds"] + time.monotonic() - begin, 1)
            write_json(path, {"seconds": seconds, "finished": finished})


def _work(folder: Path) -> dict[str, Any]:
    path = folder / "work.json"
    return json.loads(path.read_text()) if path.exists() else {"seconds": 0.0, "finished": False}


@contextmanager
def _cloud_bar() -> Iterator[Callable[[int, int], None]]:
    with tqdm(unit="cloud", leave=False) as bar:

        def progress(done: int, total: int) -> None:
            bar.total = total
            if bar.n == 0:
                bar.initial = done  # what was there already is no work of this run
            bar.update(done - bar.n)

        yield progress


# ---------------------------------------------------------------------------------------------------- episodes


def _record_episodes(
    protocol: Protocol, seeds: range, folder: Path, film: Mapping[str, Any], workers: int, say: Say
) -> None:
    missing = [seed for seed in seeds if not (folder / f"{seed}.npz").exists()]
    if not missing:
        say("      all of them were there already")
        return
    make_recorder = partial(EpisodeRecorder, protocol, folder, film, seeds)
    with closing(run_jobs(make_recorder, missing, workers)) as results:
        for seed, target, outcome in tqdm(results, total=len(missing), unit="episode", leave=False):
            tqdm.write(f"      episode {seeds.index(seed) + 1:>2}: {target}: {outcome}")


# ------------------------------------------------------------------------------------------------------ report


def _introduction(config: CaptureConfig, n_clouds: int, env: Mapping[str, Any]) -> str:
    source = env.get("objects") or {}
    unseen = (
        "The objects of the episodes are drawn anew: training has seen none of them. "
        if isinstance(source, Mapping) and source.get("path") is None and source.get("seed", 0) != config.objects.seed
        else ""
    )
    return (
        f"A UR5 with a Robotiq 2F-140 and a depth camera on its wrist is asked for a class of object, finds it among "
        f"{env['n_objects']} on the table, and lifts it. The classifier was trained minutes before on {n_clouds:,} "
        f"clouds that the simulation captured and labelled by itself. {unseen}"
        "Everything that the robot knows comes from its depth pictures and joint angles."
    )


def _split_note(trained: Mapping[str, Any]) -> str:
    counts = trained["n_samples"]
    return (
        f"PEC with {trained['parameters']:,} parameters; {counts['train']:,} clouds to train, {counts['selection']:,} "
        f"to choose the epoch, {counts['test']:,} to test, split by {trained['config']['dataset']['split']}. "
        f"Trained in {trained['training_s']:.0f} s."
    )


def _curves(run: Path) -> dict[str, list[float]]:
    """Accuracies over the epochs, as TensorBoard has them."""
    from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

    logging.getLogger("tensorboard").setLevel(logging.WARNING)  # it tells of every file
    events = EventAccumulator(str(run / "tensorboard")).Reload()
    found = set(events.Tags()["scalars"])
    names = {"training": "accuracy/train", "validation": "accuracy/selection"}
    return {word: [event.value for event in events.Scalars(tag)] for word, tag in names.items() if tag in found}


def _versions() -> dict[str, str]:
    versions = {"Python": platform.python_version(), "system": f"{platform.system()} {platform.machine()}"}
    versions["processor cores"] = str(os.cpu_count())
    return versions | {name: importlib.metadata.version(name) for name in _VERSIONS}


def _results(
    trained: Mapping[str, Any], records: list[EpisodeRecord], spent: dict[str, float], versions: dict[str, str]
) -> dict[str, Any]:
    stages = stage_times(records)
    return {
        "classifier": {
            "test_accuracy": trained["best"]["test_accuracy"],
            "test_confusion": trained["best"]["test_confusion"],
            "classes": trained["classes"],
            "n_samples": trained["n_samples"],
        },
        "summary": summarise([record.episode for record in records]),
        "episodes": [asdict(record.episode) for record in records],
        "stage_ms": {
            name: {"median": 1000 * median, "max": 1000 * most, "calls": calls}
            for name, (median, most, calls) in stages.items()
        },
        "durations_s": spent,
        "versions": versions,
    }
