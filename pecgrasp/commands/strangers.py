"""Does a classifier know what it does not know? `pecgrasp strangers checkpoint=DIR known=FOLDER strangers=FOLDER`."""

import sys
from pathlib import Path

import hydra
from omegaconf import DictConfig

from pecgrasp.settings import CONF


@hydra.main(version_base="1.3", config_path=CONF, config_name="strangers")
def main(cfg: DictConfig) -> None:
    from pec.checkpoint import read_checkpoint
    from pec.classifier import Classifier
    from pec.common.atomic_files import write_json, write_whole
    from pec.errors import CheckpointError, DatasetError
    from pecgrasp_env.experiments.strangers import answered, measure
    from pecgrasp_env.experiments.strangers_page import render

    folders = {"known": cfg.known, "strangers": cfg.strangers}
    if cfg.seen is not None:
        folders = {"seen": cfg.seen} | folders
    try:
        classifier = Classifier.load(cfg.checkpoint)
        parts = {name: answered(classifier, folder, strangers=name == "strangers") for name, folder in folders.items()}
        results = measure(parts, read_checkpoint(cfg.checkpoint).unknown_below)
    except (CheckpointError, DatasetError) as error:
        sys.exit(f"pecgrasp strangers: {error}")
    output = Path(cfg.output)
    write_json(output / "results.json", {"checkpoint": cfg.checkpoint, "sets": folders, **results})
    write_whole(output / "strangers.html", render(parts, results, cfg.checkpoint))
    print(f"area under the ROC curve {results['auc']:.4f}; threshold {results['threshold']:.3f}")
    print(f"{'':10}{'things':>7}{'clouds':>8}{'kept %':>8}{'interval over things':>22}")
    for name, row in results["parts"].items():
        low, high = (100 * end for end in row["at"]["interval"])
        kept = 100 * row["at"]["kept"]
        print(f"{name:10}{row['instances']:>7}{row['clouds']:>8}{kept:>8.1f}{f'{low:.1f} to {high:.1f}':>22}")
    print(f"page: {output / 'strangers.html'}")
