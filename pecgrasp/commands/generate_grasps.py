"""Generate grasp labels: `pecgrasp generate-grasps out=DIR`; settings in conf/generate_grasps.yaml."""

import hydra
from omegaconf import DictConfig

from pec.common.atomic_files import write_json
from pecgrasp.generation_job import generation_job
from pecgrasp.progress import progress_bar
from pecgrasp.settings import CONF, plain
from pecgrasp_env.capture.grasps.card import write_grasps_card
from pecgrasp_env.capture.grasps.config import GraspsConfig
from pecgrasp_env.capture.grasps.generate import generate_grasps
from pecgrasp_env.capture.grasps.summary import summarise_grasps
from pecgrasp_env.capture.grasps.trials import OUTCOMES


@hydra.main(version_base="1.3", config_path=CONF, config_name="generate_grasps")
def main(cfg: DictConfig) -> None:
    with (
        generation_job(cfg, "generate-grasps", "scene") as job,
        progress_bar("mesh", shown=cfg.progress, title="convex parts") as preparing,
    ):
        config = GraspsConfig.from_settings(plain(cfg))
        done = generate_grasps(config, cfg.out, on_error=cfg.on_error, preparing=preparing, **job)
    share = job["share"]
    summary = summarise_grasps(done)
    write_json(done.directory / f"results{'' if share is None else share.suffix}.json", summary)
    for title, rows in (("sampler", summary["samplers"]), ("class", summary["classes"])):
        print(f"{title:18}" + "".join(f"{outcome:>24}" for outcome in OUTCOMES))
        for name, counts in rows.items():
            total = max(sum(counts.values()), 1)
            print(f"{name:18}" + "".join(f"{n:>16} {n / total:>6.1%}" for n in counts.values()))
    print(f"not kept: {summary['rejected']}")
    for name, why in summary["skipped"].items():
        print(f"skipped {name}: {why}")
    print(
        f"{summary['new_grasps']} new labels in {summary['seconds']} s ({summary['grasps_per_second']} a second, "
        f"{summary['grasps_per_core_second']} a second of one core)"
    )
    print(f"data set: {done.directory}")
    if share is None:
        print(f"data card: {write_grasps_card(done.directory)}")
