"""Generate labelled clouds: `pecgrasp generate out=DIR`; settings in conf/generate.yaml."""

import hydra
from omegaconf import DictConfig

from pec.common.atomic_files import write_json
from pecgrasp.generation_job import generation_job
from pecgrasp.progress import progress_bar
from pecgrasp.settings import CONF, plain
from pecgrasp_env.capture import CaptureConfig, generate, summarise, write_card


@hydra.main(version_base="1.3", config_path=CONF, config_name="generate")
def main(cfg: DictConfig) -> None:
    with (
        generation_job(cfg, "generate", "cloud") as job,
        progress_bar("mesh", shown=cfg.progress, title="convex parts") as preparing,
    ):
        config = CaptureConfig.from_settings(plain(cfg))
        more = {"on_error": cfg.on_error, "frames_at_once": cfg.frames_at_once, "preparing": preparing}
        generation = generate(config, cfg.out, **more, **job)
        summary = summarise(generation)
    share = job["share"]
    write_json(generation.directory / f"results{'' if share is None else share.suffix}.json", summary)
    print(
        f"{'class':18}{'instances':>10}{'clouds':>8}{'points: 5 %':>13}{'median':>8}{'95 %':>7}{'median depth m':>16}"
    )
    for row in summary["classes"]:
        if not row["clouds"]:
            print(f"{row['class']:18}{row['instances']:>10}{0:>8}")
            continue
        print(
            f"{row['class']:18}{row['instances']:>10}{row['clouds']:>8}{row['points'][0]:>13}{row['points'][1]:>8}"
            f"{row['points'][2]:>7}{'–' if row['median_depth_m'] is None else row['median_depth_m']:>16}"
        )
    print(f"draws that were not kept: {summary['rejected']}")
    for instance, what in generation.mended.items():
        print(f"mended {instance}: {what}")
    for instance, why in summary["skipped"].items():
        print(f"skipped {instance}: {why}")
    print(f"{summary['new_clouds']} new clouds in {summary['seconds']} s ({summary['clouds_per_second']} clouds/s)")
    print(f"data set: {generation.directory}")
    if share is None:
        print(f"data card: {write_card(generation.directory)}")
