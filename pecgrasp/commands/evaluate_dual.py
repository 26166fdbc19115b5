"""How often two arms lift a heavy thing level, beside one arm and two random regions; conf/evaluate_dual.yaml."""

import sys

import hydra
from omegaconf import DictConfig

from pecgrasp.progress import progress_bar
from pecgrasp.settings import CONF, plain


@hydra.main(version_base="1.3", config_path=CONF, config_name="evaluate_dual")
def main(cfg: DictConfig) -> None:
    from pecgrasp_env.envs.validation import TaskError
    from pecgrasp_env.evaluation.run import EvaluationError
    from pecgrasp_env.experiments.two_arms.run import evaluate_dual
    from pecgrasp_env.experiments.two_arms.tables import as_markdown
    from pecgrasp_env.sensor.intrinsics import SensorError

    try:
        with progress_bar("episode", shown=cfg.progress) as progress:
            results = evaluate_dual(plain(cfg), progress)
    except (EvaluationError, SensorError, TaskError) as error:
        sys.exit(f"pecgrasp evaluate-dual: {error}")
    except KeyboardInterrupt:
        sys.exit(f"stopped; what is whole lies in {cfg.out}, and the same command goes on")
    print(f"{as_markdown(results)}\nresults: {cfg.out}/results.json")
