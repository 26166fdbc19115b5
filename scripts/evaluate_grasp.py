"""Evaluate the policy: `python scripts/evaluate_grasp.py checkpoint=DIR`; settings and their meaning in
conf/evaluate.yaml.
"""

import json
import os
from pathlib import Path

import hydra
from omegaconf import DictConfig, OmegaConf
from tqdm import tqdm

from pecgrasp_env.evaluation import Protocol, run_episodes, summarise, table


@hydra.main(version_base="1.3", config_path="../conf", config_name="evaluate")
def main(cfg: DictConfig) -> float:
    settings = OmegaConf.to_container(cfg, resolve=True)
    protocol = Protocol(settings["env"], settings["checkpoint"], settings["planner"], settings["policy"])
    seeds = range(cfg.first_seed, cfg.first_seed + cfg.episodes)
    out = Path(cfg.output)
    with tqdm(total=cfg.episodes, disable=not cfg.progress, unit="episode") as bar:
        episodes = run_episodes(protocol, seeds, out, workers=cfg.workers, on_episode=lambda _: bar.update())
    summary = summarise(episodes)
    temporary = out / "results.json.tmp"
    temporary.write_text(json.dumps(summary, indent=2))
    os.replace(temporary, out / "results.json")
    print(table(summary))
    return summary["outcomes"]["success"]["share"]


if __name__ == "__main__":
    main()
