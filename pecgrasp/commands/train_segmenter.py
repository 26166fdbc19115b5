"""Train the segmenter on labelled frames: `pecgrasp train-segmenter frames=DIR [output=…]`."""

from pathlib import Path

import hydra
from omegaconf import DictConfig

from pecgrasp.progress import progress_bar
from pecgrasp.settings import CONF
from pecgrasp_env.experiments.train_segmenter import FILE, train_segmenter


@hydra.main(version_base="1.3", config_path=CONF, config_name="train_segmenter")
def main(cfg: DictConfig) -> None:
    output = Path(cfg.output)
    folders = [Path(folder) for folder in ([cfg.frames] if isinstance(cfg.frames, str) else cfg.frames)]
    val = None if cfg.val is None else Path(cfg.val)
    with progress_bar("frame", shown=cfg.progress, title="patches") as progress:
        results = train_segmenter(folders, output, val=val, seed=cfg.seed, progress=progress)
    for name in ("found_50", "found_75", "found_75_half_visible", "segments_right_50"):
        count, n = results[name]
        print(f"{name:24} {100 * count / max(n, 1):5.1f} %  {count} of {n}")
    print(f"\ntrees: {output / FILE}   page: {output / 'report.html'}")
    print(f"use them: pecgrasp segment FILE +segmenter.relations={output / FILE}")
