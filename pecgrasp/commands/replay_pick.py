"""A recorded pick, planned again: `pecgrasp replay-pick folder=…`; settings in conf/replay_pick.yaml."""

import json
import sys
from pathlib import Path

import hydra
from hydra.utils import instantiate
from omegaconf import DictConfig
from omegaconf.errors import MissingMandatoryValue

from pecgrasp.commands.pick import asked, classifier_of
from pecgrasp.settings import CONF, plain
from pecgrasp_env.policy.scripted import ScriptedPolicy
from pecgrasp_env.real.errors import RobotError
from pecgrasp_env.real.pick_record import recorded_arm, recorded_settings
from pecgrasp_env.real.pick_run import run_replay, view_of


@hydra.main(version_base="1.3", config_path=CONF, config_name="replay_pick")
def replay_pick(cfg: DictConfig) -> None:
    try:
        settings = plain(cfg, complete=True)
        folder = Path(settings["folder"])
        checkpoint = settings["checkpoint"] or recorded_settings(folder)["checkpoint"]
        policy = ScriptedPolicy(
            classifier_of(checkpoint),
            instantiate(settings["planner"]),
            min_confidence=settings["min_confidence"],
            arm=recorded_arm(folder),
        )
        with view_of(settings, None, print) as view:
            decisions = run_replay(folder, settings["target"], policy, print, view)
            if view is not None:
                asked(f"close the view at {view.address}")
    except MissingMandatoryValue as error:
        sys.exit(f"pecgrasp replay-pick: {error.full_key}=… must be given: what pecgrasp pick has left")
    except (RobotError, ValueError, OSError) as error:
        sys.exit(f"pecgrasp replay-pick: {error}")
    (folder / "replayed.json").write_text(json.dumps(decisions, indent=1) + "\n")
    print(f"to look at: {folder}/replayed.html")


def main() -> None:
    replay_pick()
