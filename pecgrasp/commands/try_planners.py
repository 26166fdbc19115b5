"""Try planners' first grasps on the same scenes: `pecgrasp try-planners out=DIR`; conf/try_planners.yaml."""

import sys
from typing import Any

import hydra
from hydra.utils import instantiate
from omegaconf import DictConfig

from pec.common.atomic_files import write_json
from pec.grasps.labels import GraspLabels
from pecgrasp.generation_job import generation_job
from pecgrasp.progress import progress_bar
from pecgrasp.settings import CONF, complete
from pecgrasp_env.capture.grasps.config import GraspsConfig
from pecgrasp_env.capture.grasps.generate import generate_grasps
from pecgrasp_env.experiments.tried_planners import compare_planners, plan_times_ms


@hydra.main(version_base="1.3", config_path=CONF, config_name="try_planners")
def main(cfg: DictConfig) -> None:
    settings = complete(cfg, "try-planners")
    planners = settings["planners"]
    if settings["reference"] not in planners:
        sys.exit(f"pecgrasp try-planners: reference={settings['reference']} is none of {', '.join(planners)}")
    with (
        generation_job(cfg, "try-planners", "scene") as job,
        progress_bar("mesh", shown=cfg.progress, title="convex parts") as preparing,
    ):
        config = GraspsConfig.from_settings(settings)
        done = generate_grasps(config, cfg.out, on_error=cfg.on_error, preparing=preparing, **job)
    if job["share"] is not None:
        print(f"a share of the scenes is in {done.directory}; the command without shard= compares when all are there")
        return
    labels = GraspLabels(done.directory)
    results = compare_planners(labels, settings["reference"])
    made = {name: instantiate(each) for name, each in planners.items()}
    results["plan_ms"] = plan_times_ms(made, list(labels.scenes()))
    results |= {"skipped": done.skipped, "rejected": done.rejected}
    write_json(done.directory / "results.json", results)
    print(table(results))


def table(results: dict[str, Any]) -> str:
    """A row a planner."""
    lines = [f"{'planner':16}{'held':>7}{'of':>6}{'share':>8}  {'over objects':16}{'no grasp':>9}{'p':>8}{'ms':>8}"]
    against = {row["second"]: f"{row['p']:.3f}" for row in results["comparisons"]}
    for name, row in results["planners"].items():
        low, high = row["interval_over_objects"]
        between = f"{low:.1%} to {high:.1%}"
        share = f"{name:16}{row['held']:>7}{row['scenes']:>6}{row['share']:>8.1%}  {between:16}"
        lines.append(
            f"{share}{row['outcomes']['no grasp']:>9}{against.get(name, ''):>8}{results['plan_ms'][name]:>8.1f}"
        )
    return "\n".join(lines)
