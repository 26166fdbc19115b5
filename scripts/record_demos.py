"""Record the expert for others to learn from: `python scripts/record_demos.py env.n_objects=1 env.classes=[mouse]`.

Leaves ManiSkill trajectories. The same command goes on where it was interrupted. Settings: conf/record_demos.yaml.
"""

import sys
from pathlib import Path

import hydra
from omegaconf import DictConfig, OmegaConf
from tqdm import tqdm

from pecgrasp_env.evaluation.run import EvaluationError
from pecgrasp_env.evaluation.summary import table
from pecgrasp_env.learning.demonstrations import DemonstrationError, Recording, record


@hydra.main(version_base="1.3", config_path="../conf", config_name="record_demos")
def main(cfg: DictConfig) -> None:
    settings = OmegaConf.to_container(cfg, resolve=True, throw_on_missing=True)
    out = Path(cfg.out)
    try:
        recording = Recording(**{name: settings[name] for name in Recording.__dataclass_fields__})
        with tqdm(disable=not cfg.progress, unit="episode") as bar:

            def progress(done: int, total: int) -> None:
                bar.total = total
                if bar.n == 0:
                    bar.initial = done  # what was there already counts neither as work nor in the time left
                bar.update(done - bar.n)

            seeds = range(cfg.first_seed, cfg.first_seed + cfg.episodes)
            results = record(recording, seeds, out, keep=cfg.keep, workers=cfg.workers, progress=progress)
    except (DemonstrationError, EvaluationError) as error:
        sys.exit(f"record_demos: {error}")
    except KeyboardInterrupt:
        print(f"stopped; all whole episodes lie in {out}, and the same command goes on", file=sys.stderr)
        sys.exit(130)
    print(table(results))
    print(f"{results['kept']} kept: {results['trajectories']}")


if __name__ == "__main__":
    main()
