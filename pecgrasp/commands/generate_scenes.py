"""Generate labelled frames of crowded tables: `pecgrasp generate-scenes out=DIR`; conf/generate_scenes.yaml."""

import sys

import hydra
from omegaconf import DictConfig

from pec.errors import DatasetError
from pecgrasp.progress import progress_bar
from pecgrasp.settings import CONF, plain
from pecgrasp_env.capture.config import CaptureError
from pecgrasp_env.capture.scenes.card import write_frames_card
from pecgrasp_env.capture.scenes.config import FramesConfig
from pecgrasp_env.capture.scenes.generate import generate_frames
from pecgrasp_env.common.job_share import JobShare, JobShareError
from pecgrasp_env.objects import ObjectError


@hydra.main(version_base="1.3", config_path=CONF, config_name="generate_scenes")
def main(cfg: DictConfig) -> None:
    try:
        config = FramesConfig.from_settings(plain(cfg))
        share = None if cfg.shard is None else JobShare.parse(cfg.shard)
        with progress_bar("frame", shown=cfg.progress) as progress:
            done = generate_frames(config, cfg.out, workers=cfg.workers, share=share, progress=progress)
    except (CaptureError, DatasetError, JobShareError, ObjectError) as error:
        sys.exit(f"pecgrasp generate-scenes: {error}")
    except KeyboardInterrupt:
        print(f"stopped; what is whole lies in {cfg.out}, and the same command goes on", file=sys.stderr)
        sys.exit(130)
    print(f"{done.n_new} new frames of {done.n_frames} in {done.seconds:.0f} s; drawn anew: {done.rejected}")
    print(f"data set: {done.directory}")
    if share is None:
        print(f"data card: {write_frames_card(done.directory)}")
