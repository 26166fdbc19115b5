"""Classify one cloud: `pecgrasp classify FILE checkpoint=DIR`."""

import sys
from pathlib import Path

import hydra
import numpy as np
from omegaconf import DictConfig

from grasping.cloud_files import read_cloud, valid_points
from grasping.errors import CloudError as FileError
from pec.classifier import Classifier
from pec.common.atomic_files import write_json
from pec.errors import CheckpointError, CloudError
from pecgrasp.settings import CONF, file_as_override


@hydra.main(version_base="1.3", config_path=CONF, config_name="classify")
def classify(cfg: DictConfig) -> None:
    try:
        points = valid_points(read_cloud(cfg.cloud)) * np.float32(cfg.scale)
        prediction = Classifier.load(cfg.checkpoint).predict(points)
    except (CheckpointError, CloudError, FileError, FileNotFoundError) as error:
        sys.exit(f"pecgrasp classify: {error}")
    print(
        f"{prediction.label}, known with {100 * prediction.known:.2f} %, confidence {100 * prediction.confidence:.2f} %"
    )
    for label, probability in sorted(prediction.probabilities.items(), key=lambda item: -item[1]):
        print(f"{label:20}{100 * probability:7.2f} %")
    results = {
        "label": prediction.label,
        "known": prediction.known,
        "confidence": prediction.confidence,
        "probabilities": prediction.probabilities,
    }
    write_json(Path(cfg.output) / "results.json", results)


def main() -> None:
    sys.argv[1:] = file_as_override(sys.argv[1:])
    classify()
