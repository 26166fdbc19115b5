"""A picture of the objects: `pecgrasp contact-sheet out=FILE.png`; settings in conf/contact_sheet.yaml."""

import sys
from pathlib import Path

import hydra
from omegaconf import DictConfig

from pecgrasp.settings import CONF
from pecgrasp_env.objects import ObjectError, open_objects
from pecgrasp_env.objects.contact_sheet import contact_sheet


@hydra.main(version_base="1.3", config_path=CONF, config_name="contact_sheet")
def main(cfg: DictConfig) -> None:
    try:
        objects = open_objects(
            cfg.objects.path,
            cfg.objects.classes,
            cfg.instances,
            cfg.objects.seed,
            cfg.objects.scale,
            cfg.objects.allow_open,
        )
        groups = [
            (name, [objects.load(name, i) for i in range(min(cfg.instances, len(objects.names(name))))])
            for name in objects.classes
        ]
    except ObjectError as error:
        sys.exit(f"pecgrasp contact-sheet: {error}")
    Path(cfg.out).parent.mkdir(parents=True, exist_ok=True)
    contact_sheet(groups, cfg.size).save(cfg.out, optimize=True)
    print(cfg.out)
