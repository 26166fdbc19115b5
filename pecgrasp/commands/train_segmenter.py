"""Train the segmenter on labelled frames: `pecgrasp train-segmenter frames=DIR [output=…]`.

The same command goes on where it was interrupted. Settings: conf/train_segmenter.yaml.
"""

import sys
from pathlib import Path

import hydra
from omegaconf import DictConfig

from pec.errors import ConfigError, DatasetError
from pecgrasp.progress import progress_bar
from pecgrasp.settings import CONF
from pecgrasp_env.experiments.train_segmenter import FILE, train_segmenter


@hydra.main(version_base="1.3", config_path=CONF, config_name="train_segmenter")
def main(cfg: DictConfig) -> None:
    output = Path(cfg.output)
    folders = [Path(folder) for folder in ([cfg.frames] if isinstance(cfg.frames, str) else cfg.frames)]
    val = None if cfg.val is None else Path(cfg.val)
    try:
        with progress_bar("frame", shown=cfg.progress, title="patches") as progress:
            results = train_segmenter(folders, output, val=val, seed=cfg.seed, progress=progress)
    except (ConfigError, DatasetError, ImportError) as error:
        sys.exit(f"pecgrasp train-segmenter: {error}")
    except KeyboardInterrupt:
        print(f"stopped; what is whole lies in {output}, and the same command goes on", file=sys.stderr)
        sys.exit(130)
    for name in ("found_50", "found_75", "found_75_half_visible", "segments_right_50"):
        count, n = results[name]
        print(f"{name:24} {100 * count / max(n, 1):5.1f} %  {count} of {n}")
    print(f"\ntrees: {output / FILE}   page: {output / 'report.html'}")
    print(f"use them: pecgrasp segment FILE +segmenter.relations={output / FILE}")
