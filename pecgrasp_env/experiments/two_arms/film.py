"""A film of one episode of two arms, and beside it a strip of its moments."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from PIL import Image

from pec.common.atomic_files import replacing
from pecgrasp_env.common.video import Film, compose
from pecgrasp_env.experiments.two_arms.episode import OUTCOME_WORDS, run_dual_episode
from pecgrasp_env.experiments.two_arms.tables import TITLES
from pecgrasp_env.policy.two_arms.scripted import TwoArmPolicy

_STEPS_A_FRAME, _FPS = 5, 8  # twice the true speed
_LAST_PICTURE_S = 1.6
_STRIP = 6  # moments


def film_path(out: Path, seed: int, method: str) -> Path:
    """OUT/films/SEED_METHOD.mp4; the strip has the same name, .webp."""
    return out / "films" / f"{seed}_{method}.mp4"


def film_episode(make_env: Callable[..., gym.Env], policy: TwoArmPolicy, seed: int, path: Path) -> None:
    """Run an episode again and record it. make_env: takes keyword arguments of DualGrasp-v1."""
    path.parent.mkdir(parents=True, exist_ok=True)
    env = make_env(render_mode="rgb_array", human_render_camera_configs={"width": 480, "height": 360})
    pictures: list[np.ndarray] = []
    steps = 0
    with Film(path, _FPS) as film:

        def picture(env: Any, badge: tuple[str, str] | None = None) -> np.ndarray:
            name = f"{TITLES[policy.method]}: {env.unwrapped.model.class_name.replace('_', ' ')}"
            heading = f"{name}, {env.unwrapped.model.mass:.1f} kg"
            pictures.append(
                compose(np.asarray(env.render()[0].cpu(), np.uint8), heading, policy.log.doing, badge=badge)
            )
            return pictures[-1]

        def on_step(env: Any) -> None:
            nonlocal steps
            if steps % _STEPS_A_FRAME == 0:
                film.add(picture(env))
            steps += 1

        episode = run_dual_episode(env, policy, seed, on_step)
        film.add(picture(env, OUTCOME_WORDS[episode.outcome]), _LAST_PICTURE_S)
    env.close()
    chosen = np.linspace(0, len(pictures) - 1, _STRIP).round().astype(int)
    rows = [np.concatenate([pictures[k] for k in part], axis=1) for part in np.split(chosen, 2)]
    with replacing(path.with_suffix(".webp")) as temporary:
        Image.fromarray(np.concatenate(rows)).save(temporary, "WEBP", quality=70)
