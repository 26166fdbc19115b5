"""Write a checkpoint's network as ONNX: `pecgrasp export-onnx checkpoint=DIR`; the file says how to use it."""

import sys
from pathlib import Path

import hydra
from omegaconf import DictConfig

from pec.checkpoint import read_checkpoint
from pec.common.atomic_files import write_json
from pec.errors import CheckpointError, ConfigError
from pec.onnx_export import export_onnx
from pecgrasp.settings import CONF


@hydra.main(version_base="1.3", config_path=CONF, config_name="export_onnx")
def main(cfg: DictConfig) -> None:
    output = Path(cfg.output)
    try:
        path = export_onnx(read_checkpoint(cfg.checkpoint), output / "model.onnx")
    except (CheckpointError, ConfigError) as error:
        sys.exit(f"pecgrasp export-onnx: {error}")
    write_json(output / "results.json", {"model": str(path), "bytes": path.stat().st_size})
    print(path)
