"""Generate labelled frames of crowded tables: `pecgrasp generate-scenes out=DIR`; conf/generate_scenes.yaml."""

import hydra
from omegaconf import DictConfig

from pecgrasp.generation_job import generation_job
from pecgrasp.settings import CONF, plain
from pecgrasp_env.capture.scenes.card import write_frames_card
from pecgrasp_env.capture.scenes.config import FramesConfig
from pecgrasp_env.capture.scenes.generate import generate_frames


@hydra.main(version_base="1.3", config_path=CONF, config_name="generate_scenes")
def main(cfg: DictConfig) -> None:
    with generation_job(cfg, "generate-scenes", "frame") as job:
        done = generate_frames(FramesConfig.from_settings(plain(cfg)), cfg.out, **job)
    print(f"{done.n_new} new frames of {done.n_frames} in {done.seconds:.0f} s; drawn anew: {done.rejected}")
    print(f"data set: {done.directory}")
    if job["share"] is None:
        print(f"data card: {write_frames_card(done.directory)}")
