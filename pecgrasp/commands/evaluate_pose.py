"""Measure how well poses of known objects are found: `pecgrasp evaluate-pose clouds=[DIR] frames=[DIR] …`."""

import sys
from pathlib import Path
from typing import Any

import hydra
from omegaconf import DictConfig

from grasping import ModelError, load_models
from pec.common.atomic_files import write_json, write_whole
from pec.errors import DatasetError
from pecgrasp.progress import progress_bar
from pecgrasp.settings import CONF
from pecgrasp_env.experiments.known_poses.cases import cloud_cases, frame_cases, partly_hidden, real_views
from pecgrasp_env.experiments.known_poses.chapter5 import chosen_regions, final_poses
from pecgrasp_env.experiments.known_poses.methods import METHODS, installed
from pecgrasp_env.experiments.known_poses.page import render
from pecgrasp_env.experiments.known_poses.run import Rows, run_clouds, run_frames
from pecgrasp_env.experiments.known_poses.tables import cloud_results, frame_results, table
from pecgrasp_env.experiments.known_poses.task_scenes import task_frames
from pecgrasp_env.objects import ObjectError
from pecgrasp_env.scene.placement import PlacementError


@hydra.main(version_base="1.3", config_path=CONF, config_name="evaluate_pose")
def main(cfg: DictConfig) -> None:
    output = Path(cfg.output)
    rows = Rows(output / "rows.jsonl")
    methods = list(cfg.methods)
    if unknown := [name for name in methods if name not in METHODS]:
        sys.exit(f"pecgrasp evaluate-pose: no method {unknown[0]!r}; there are {', '.join(METHODS)}")
    if missing := [name for name in methods if not installed(name)]:
        print(f"not installed, left out: {', '.join(missing)} (pip install 'pecgrasp[pose-rivals]')")
        methods = [name for name in methods if name not in missing]
    if senseless := [share for share in cfg.hidden if not 0 <= share < 1]:
        sys.exit(f"pecgrasp evaluate-pose: hidden = {senseless[0]} is no share of a cloud; it must be in [0, 1)")
    try:
        for folder in cfg.clouds:
            cases = list(cloud_cases(Path(folder), cfg.per_object))
            for share in cfg.hidden:
                group = Path(folder).name + (f", {share:.0%} hidden" if share else "")
                with progress_bar("cloud", shown=cfg.progress, title=group) as progress:
                    run_clouds(group, [partly_hidden(case, share) for case in cases], methods, rows, progress)
        for file in cfg.views:
            with progress_bar("view", shown=cfg.progress, title=Path(file).stem) as progress:
                run_clouds(Path(file).stem, list(real_views(Path(file))), methods, rows, progress)
        for folder in cfg.frames:
            models, frames_here = frame_cases(Path(folder), cfg.most_frames)
            cases_here = list(frames_here)
            with progress_bar("frame", shown=cfg.progress, title=Path(folder).name) as progress:
                run_frames(Path(folder).name, models, cases_here, rows, progress, total=len(cases_here))
        for clutter in cfg.clutters:
            if cfg.scene.models is None:
                sys.exit("pecgrasp evaluate-pose: clutters needs scene.models=FOLDER, the meshes that are known")
            models, frames_here = task_frames(clutter, cfg.scene)
            with progress_bar("scene", shown=cfg.progress, title=clutter) as progress:
                run_frames("SelectiveGrasp-v1", models, frames_here, rows, progress, total=cfg.scene.scenes)
    except (DatasetError, ModelError, ObjectError, PlacementError, OSError) as error:
        sys.exit(f"pecgrasp evaluate-pose: {error}")
    chapter5: dict[str, Any] = {}
    if cfg.chapter5 is not None:
        shown = [model for folder in cfg.chapter5 for model in load_models(folder, allow_open=True)]
        chapter5 = {"final_poses": final_poses(shown), "chosen_regions": chosen_regions(shown)}
    clouds, frames = cloud_results(rows.rows), frame_results(rows.rows)
    text = table(clouds, frames)
    print(text)
    write_whole(output / "table.md", text)
    write_whole(output / "page.html", render(rows.rows, clouds, frames))
    write_json(output / "results.json", {"clouds": clouds, "frames": frames, "chapter5": chapter5})
