"""A class for every point against one for every cut-out: `pecgrasp evaluate-points …`; conf/evaluate_points.yaml."""

import sys
from pathlib import Path

import hydra
from omegaconf import DictConfig

from pec import Classifier
from pec.common.atomic_files import write_json
from pec.errors import CheckpointError, ConfigError, DatasetError
from pec.segmentation import PointSegmenter
from pecgrasp.progress import progress_bar
from pecgrasp.settings import CONF, complete
from pecgrasp_env.experiments.point_segmentation import compare_on_frames


@hydra.main(version_base="1.3", config_path=CONF, config_name="evaluate_points")
def main(cfg: DictConfig) -> None:
    settings = complete(cfg, "evaluate-points")
    try:
        points = PointSegmenter.load(settings["checkpoint"], settings["n_points"])
        classifier = Classifier.load(settings["classifier"], unknown_below=settings["unknown_below"])
        with progress_bar("frame", shown=cfg.progress) as progress:
            results = compare_on_frames(Path(settings["frames"]), points, classifier, progress)
    except (CheckpointError, ConfigError, DatasetError) as error:
        sys.exit(f"pecgrasp evaluate-points: {error}")
    write_json(Path(settings["output"]) / "results.json", results | {"settings": settings})
    print(
        f"{'':20}{'found':>16}{'at least half visible':>24}{'named rightly':>16}{'points right %':>16}"
        f"{'mean IoU %':>12}{'ms':>7}"
    )
    for name, row in results["methods"].items():
        found, half, named = (
            f"{row[key]['count']} of {row[key]['n']}" for key in ("found", "found_half_visible", "named_rightly")
        )
        print(
            f"{name:20}{found:>16}{half:>24}{named:>16}{100 * row['accuracy']:>16.1f}{100 * row['mean_iou']:>12.1f}"
            f"{row['median_ms']:>7.0f}"
        )
    for pair in results["comparisons"]:
        print(
            f"{pair['method']}: {pair['only_it']} only so, {pair['only_other']} only by {pair['against']}, "
            f"p = {pair['p']:.2g}"
        )
