"""Where the camera is: `pecgrasp calibrate board`, `… record FOLDER`, `… FOLDER`, `… check FOLDER`."""

import json
import re
import sys
from pathlib import Path
from typing import Any

import hydra
import numpy as np
from omegaconf import DictConfig
from omegaconf.errors import OmegaConfBaseException

from grasping import CloudError, ConfigError
from pecgrasp.from_settings import made
from pecgrasp.settings import CONF, plain
from pecgrasp_env.real.calibration.board_sheet import write_sheet
from pecgrasp_env.real.calibration.calibrate import Calibration
from pecgrasp_env.real.calibration.errors import CalibrationError
from pecgrasp_env.real.calibration.folder import calibrate_folder
from pecgrasp_env.real.calibration.record_views import record_views
from pecgrasp_env.real.calibration.touch_up import TouchUp, check_folder
from pecgrasp_env.real.calibration.ur_flange import ur_flange
from pecgrasp_env.real.camera.realsense import infrared_image
from pecgrasp_env.real.errors import RobotError
from pecgrasp_env.real.ur_models import URModel
from pecgrasp_env.robot.camera_mount import MountError, mount_of, read_mount

REFUSALS = (CalibrationError, CloudError, ConfigError, RobotError, MountError, OSError, OmegaConfBaseException)


@hydra.main(version_base="1.3", config_path=CONF, config_name="calibrate")
def calibrate(cfg: DictConfig) -> None:
    actions = {"board": print_board, "record": record, "hand_eye": hand_eye, "check": check}
    try:
        if cfg.action not in actions:
            raise ConfigError(f"action={cfg.action}: one of {', '.join(actions)}")
        actions[cfg.action](cfg, Path(cfg.output))
    except REFUSALS as error:
        sys.exit(f"pecgrasp calibrate: {str(error).splitlines()[0]}")


def print_board(cfg: DictConfig, output: Path) -> None:
    board = made(cfg.board)
    output.mkdir(parents=True, exist_ok=True)
    for suffix in ("pdf", "svg", "png"):
        write_sheet(output / f"board.{suffix}", board, cfg.paper)
    print(f"{output}/board.pdf, .svg, .png: print one at 100 %, glue it on a flat plate, measure its ruler of 100 mm")


def record(cfg: DictConfig, output: Path) -> None:
    if cfg.host is None:
        raise ConfigError("host=… must be given: the address of the arm's controller, which says where the hand is")
    board, model = made(cfg.board), URModel.from_mapping(plain(cfg.robot))
    flange = ur_flange(cfg.host, model)
    count = record_views(
        Path(cfg.views), board, lambda: infrared_image(resolution=cfg.resolution), flange, one_more, print, cfg.parent
    )
    print(f"{count} pictures in {cfg.views}; now: pecgrasp calibrate {cfg.views}")


def one_more(words: str) -> bool:
    try:
        return input(f"{words}; Enter takes it, q ends: ").strip().lower() not in ("q", "quit")
    except EOFError:
        return False


def hand_eye(cfg: DictConfig, output: Path) -> None:
    result: Calibration = calibrate_folder(Path(cfg.views), made(cfg.board), cfg.parent, output)
    print(f"{'method':14}{'corners px':>11}{'left one out mm':>17}{'°':>7}   place mm")
    for each in result.hand_eye.methods:
        pixels, shift, turn = each.rms
        place = " ".join(f"{value:7.2f}" for value in 1e3 * each.T_mount_camera[:3, 3])
        print(f"{each.method:14}{pixels:11.3f}{1e3 * shift:17.2f}{np.degrees(turn):7.2f}   {place}")
    for name, why in result.left_out:
        print(f"left out: {name}: {why}")
    for words in result.words:
        print(f"to mend: {words}")
    error = result.hand_eye.uncertainty
    sure = f"± {1e3 * np.linalg.norm(error[:3]):.2f} mm, ± {np.degrees(np.linalg.norm(error[3:])):.2f}°"
    print(
        f"{len(result.used)} views: {output}/T_{cfg.parent}_camera.yaml, {sure}; to look at: {output}/calibration.html"
    )


def check(cfg: DictConfig, output: Path) -> None:
    if cfg.mount is None and cfg.parent != "tool0":
        raise ConfigError(f"mount=FILE must be given with parent={cfg.parent}")
    mount = mount_of(cfg.mount) if cfg.parent == "tool0" else read_mount(cfg.mount, cfg.parent)
    result: TouchUp = check_folder(Path(cfg.views), mount, cfg.parent)
    print(f"{'view':24}{'table mm':>10}{'°':>7}{'object mm':>11}{'°':>7}")
    for row in result.rows():
        print(f"{row[0]:24}{row[1]:>10}{row[2]:>7}{row[3]:>11}{row[4]:>7}")
    for words in result.words:
        print(f"to mend: {words}")
    output.mkdir(parents=True, exist_ok=True)
    summary: dict[str, Any] = result.as_results()
    (output / "results.json").write_text(json.dumps(summary, indent=1, allow_nan=False) + "\n", encoding="utf-8")
    if result.words:
        sys.exit(1)
    print(
        f"the views agree; the table lies at z = {1e3 * result.table_height:.1f} mm: does a fingertip touch it there?"
    )


def main() -> None:
    sys.argv[1:] = with_names(sys.argv[1:])
    calibrate()


def with_names(words: list[str]) -> list[str]:
    """The same words; those in front that are no overrides become action= and views=."""
    found: list[str] = []
    if words and words[0] in ("board", "record", "check"):
        found.append(f"action={words[0]}")
        words = words[1:]
    if words and not words[0].startswith(("-", "+", "~")) and "=" not in words[0]:
        name = re.sub(r'(\\*)"', r'\1\1\\"', words[0])
        found.append(f'views="{name}"')
        words = words[1:]
    return [*found, *words]
