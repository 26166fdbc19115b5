"""Record the expert for others to learn from: `pecgrasp record-demos env.n_objects=1 'env.classes=[mouse]'`.

Leaves ManiSkill trajectories. The same command goes on where it was interrupted. Settings: conf/record_demos.yaml.
"""

import sys
from pathlib import Path

import hydra
from omegaconf import DictConfig

from pecgrasp.progress import progress_bar
from pecgrasp.settings import CONF, plain
from pecgrasp_env.evaluation.run import EvaluationError
from pecgrasp_env.evaluation.summary import table
from pecgrasp_env.learning.demonstrations import DemonstrationError, Recording, record


@hydra.main(version_base="1.3", config_path=CONF, config_name="record_demos")
def main(cfg: DictConfig) -> None:
    settings = plain(cfg, complete=True)
    out = Path(cfg.out)
    try:
        recording = Recording(**{name: settings[name] for name in Recording.__dataclass_fields__})
        with progress_bar("episode", shown=cfg.progress) as progress:
            seeds = range(cfg.first_seed, cfg.first_seed + cfg.episodes)
            results = record(recording, seeds, out, keep=cfg.keep, workers=cfg.workers, progress=progress)
    except (DemonstrationError, EvaluationError) as error:
        sys.exit(f"pecgrasp record-demos: {error}")
    except KeyboardInterrupt:
        print(f"stopped; all whole episodes lie in {out}, and the same command goes on", file=sys.stderr)
        sys.exit(130)
    print(table(results))
    print(f"{results['kept']} kept: {results['trajectories']}")
