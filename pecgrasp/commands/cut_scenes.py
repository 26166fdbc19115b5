"""Clouds of single objects out of labelled frames: `pecgrasp cut-scenes frames=DIR out=DIR`; conf/cut_scenes.yaml."""

import sys
from pathlib import Path

import hydra
from omegaconf import DictConfig

from pec.common.atomic_files import write_json
from pec.data.dataset import UNKNOWN
from pec.data.loading import load_dataset
from pec.errors import DatasetError
from pecgrasp.progress import progress_bar
from pecgrasp.settings import CONF, complete
from pecgrasp_env.capture.scenes.cut_outs import cut_out_clouds


@hydra.main(version_base="1.3", config_path=CONF, config_name="cut_scenes")
def main(cfg: DictConfig) -> None:
    settings = complete(cfg, "cut-scenes")
    out = Path(settings["out"])
    try:
        with progress_bar("frame", shown=cfg.progress) as progress:
            clouds = load_dataset(cut_out_clouds(Path(settings["frames"]), out, progress))
    except DatasetError as error:
        sys.exit(f"pecgrasp cut-scenes: {error}")
    except KeyboardInterrupt:
        print(f"stopped; what is whole lies in {out}, and the same command goes on", file=sys.stderr)
        sys.exit(130)
    counts = {name: int((clouds.labels == i).sum()) for i, name in enumerate(clouds.classes)}
    write_json(out / "results.json", {"clouds": counts})
    for name, count in counts.items():
        print(f"{name:20}{count:>8}" + ("  parts, several together, and things of no class" if name == UNKNOWN else ""))
    print(f"data set: {out}")
