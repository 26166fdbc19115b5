"""Expert episodes for LeRobot: `pecgrasp export-lerobot source=… out=…`; settings in conf/export_lerobot.yaml."""

import sys
from pathlib import Path

import hydra
from omegaconf import DictConfig

from pecgrasp.settings import CONF, complete
from pecgrasp_env.learning.export_lerobot import FPS, NAMES, read_episodes
from pecgrasp_env.learning.lerobot_format import ExportError, write_data_set


@hydra.main(version_base="1.3", config_path=CONF, config_name="export_lerobot")
def export_lerobot(cfg: DictConfig) -> None:
    settings = complete(cfg, "export-lerobot")
    try:
        sources = settings["source"] if isinstance(settings["source"], list) else [settings["source"]]
        episodes = [episode for source in sources for episode in read_episodes(Path(source), settings["depth"])]
        write_data_set(Path(settings["out"]), episodes, FPS, settings["robot_type"], NAMES)
    except (ExportError, OSError) as error:
        sys.exit(f"pecgrasp export-lerobot: {error}")
    print(f"{len(episodes)} episodes, {sum(map(len, episodes))} moments: {settings['out']}")


def main() -> None:
    export_lerobot()
