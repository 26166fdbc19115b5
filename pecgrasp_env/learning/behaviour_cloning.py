"""An example of an agent that learns from recorded demonstrations: behaviour cloning on the state observation.

A small network takes where the arm, the gripper and the asked-for object are, and says the next joint targets and
openings ("action chunking", Zhao et al. 2023); the first of them are carried out before it looks again. It is trained
with an L1 loss on what the expert did, and on copies of every moment with the arm moved a little, from where it is to
go the expert's way again: without them small errors lead where nothing was learnt. Episodes of its own show what it
can, beside agents that idle and act at random. Read it from `train` on;
`pecgrasp_env.learning.demonstrations` makes the data.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import torch
from safetensors.torch import load_file, save_file
from torch import nn
from torch.utils.tensorboard import SummaryWriter

from pec.common.atomic_files import replacing, write_json
from pecgrasp_env.learning.rollouts import Act, acting_at_random, evaluate, idling, show
from pecgrasp_env.learning.state_features import Moments, read_demonstrations

_UNIT = np.array([0.2] * 6 + [0.07, 60.0], np.float32)  # rad, m, N: of what the network says


@dataclass(frozen=True)
class CloningConfig:
    """demos: trajectory.h5 of `record_demos`. out: folder of results.json, agent.safetensors, agent.json, tensorboard.

    chunk, execute: actions that are predicted, and carried out before the next look. width: of two hidden layers.
    copies: of every moment, each with the joints moved by a deviation drawn below ``moved`` rad.
    held_out: share of the episodes whose loss is only watched. episodes: of each evaluation on the way, from first_seed
    on, and of the two others in the end; final_episodes: of the last one, from final_seed on, looked at once.
    most_steps: of an episode of evaluation.
    """

    demos: str
    out: str
    epochs: int = 16
    batch: int = 256
    learning_rate: float = 1e-3
    width: int = 256
    chunk: int = 16
    execute: int = 8
    copies: int = 8
    moved: float = 0.04
    held_out: float = 0.1
    episodes: int = 20
    first_seed: int = 600000
    final_episodes: int = 100
    final_seed: int = 700000
    most_steps: int = 120
    seed: int = 0


class Cloned(nn.Module):
    """Features (N, F) → the next actions (N, chunk, 8) in units of `_UNIT`, the arm's from where it is."""

    mean: torch.Tensor
    deviation: torch.Tensor

    def __init__(self, n_features: int, chunk: int, width: int) -> None:
        super().__init__()
        self.register_buffer("mean", torch.zeros(n_features))
        self.register_buffer("deviation", torch.ones(n_features))
        self.layers = nn.Sequential(
            *(nn.Linear(n_features, width), nn.GELU(), nn.Linear(width, width), nn.GELU(), nn.Linear(width, chunk * 8))
        )

    def forward(self, features: torch.Tensor) -> torch.Tensor:
        return self.layers((features - self.mean) / self.deviation).unflatten(1, (-1, 8))


def samples(moments: Moments, actions: np.ndarray) -> tuple[torch.Tensor, torch.Tensor]:
    """Features (N, 36), and what the network should say (N, chunk, 8)."""
    return moments.features(), torch.from_numpy(((actions - _base(moments.q)) / _UNIT).astype(np.float32))


def _base(q: np.ndarray) -> np.ndarray:
    """(N, 1, 8): what the network's zero means."""
    return np.concatenate([q, np.tile([0.07, 60.0], (len(q), 1))], axis=1)[:, None]


def train(config: CloningConfig) -> dict[str, Any]:
    """Learn and evaluate; returns what is written to OUT/results.json. A finished run is not repeated."""
    out = Path(config.out)
    if (out / "results.json").exists() and json.loads((out / "results.json").read_text())["config"] == asdict(config):
        return json.loads((out / "results.json").read_text())
    torch.manual_seed(config.seed)
    demonstrations, env_kwargs = read_demonstrations(Path(config.demos), config.chunk)
    n_held_out = int(len(demonstrations) * config.held_out)
    learnt, watched = demonstrations[n_held_out:], demonstrations[:n_held_out]
    rng = np.random.default_rng(config.seed)
    shown = [samples(*episode) for episode in learnt]
    for moments, actions in learnt * config.copies:
        offset = rng.normal(size=moments.q.shape) * rng.uniform(0, config.moved, (len(moments.q), 1))
        shown.append(samples(moments.moved(offset), actions))
    inputs, wanted = (torch.cat(parts) for parts in zip(*shown, strict=True))
    checked = [samples(*episode) for episode in watched]
    net = Cloned(inputs.shape[1], config.chunk, config.width)
    net.mean, net.deviation = inputs.mean(dim=0), inputs.std(dim=0).clamp_min(1e-3)
    optimizer = torch.optim.AdamW(net.parameters(), lr=config.learning_rate)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, config.epochs)
    cloned = partial(acting, net, config.execute)
    env = gym.make("SelectiveGrasp-v1", **env_kwargs)
    began, curve = time.monotonic(), []
    with SummaryWriter(str(out / "tensorboard" / "cloned")) as writer:
        for epoch in range(config.epochs + 1):
            losses = {}
            if epoch > 0:
                losses["train"] = _epoch(net, optimizer, inputs, wanted, config.batch)
                schedule.step()
                if checked:
                    with torch.inference_mode():
                        losses["held_out"] = float(np.mean([_loss(net(x), y).item() for x, y in checked]))
            for name, value in losses.items():
                writer.add_scalar(f"loss/{name}", value, epoch)
            if epoch & (epoch - 1) == 0 or epoch == config.epochs:  # after 0, 1, 2, 4, 8, … epochs
                seeds = range(config.first_seed, config.first_seed + config.episodes)
                measured = evaluate(env, cloned, seeds, config.most_steps)
                curve.append({"epoch": epoch, "loss": losses, **measured})
                show(writer, measured, epoch)
    learning_s = time.monotonic() - began
    with replacing(out / "agent.safetensors") as temporary:
        save_file(net.state_dict(), temporary)
    write_json(out / "agent.json", {**asdict(config), "n_features": inputs.shape[1], "env_kwargs": env_kwargs})
    seeds = range(config.final_seed, config.final_seed + config.final_episodes)
    others: dict[str, Callable[[], Act]] = {"idle": idling, "random": partial(acting_at_random, rng)}
    final = {"cloned": evaluate(env, cloned, seeds, config.most_steps)}
    final |= {name: evaluate(env, one, seeds[: config.episodes], config.most_steps) for name, one in others.items()}
    env.close()
    for name, measured in final.items():
        with SummaryWriter(str(out / "tensorboard" / f"{name}_final")) as writer:
            for epoch in (0, config.epochs):  # a level line beside the curve
                show(writer, measured, epoch)
    results = {"demonstrations": len(learnt), "samples": len(inputs), "curve": curve, "final": final}
    results |= {"learning_s": learning_s, "seconds": time.monotonic() - began, "config": asdict(config)}
    write_json(out / "results.json", results)
    return results


def _epoch(
    net: Cloned, optimizer: torch.optim.Optimizer, inputs: torch.Tensor, wanted: torch.Tensor, batch: int
) -> float:
    """Shows the network every sample once; returns the mean loss."""
    total = 0.0
    for rows in torch.randperm(len(inputs)).split(batch):
        loss = _loss(net(inputs[rows]), wanted[rows])
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        total += loss.item() * len(rows)
    return total / len(inputs)


def _loss(said: torch.Tensor, wanted: torch.Tensor) -> torch.Tensor:
    return (said - wanted).abs().mean()


def load(folder: Path) -> tuple[Cloned, dict[str, Any]]:
    """The network that `train` left in a folder, and the settings beside it, `env_kwargs` among them."""
    settings = json.loads((folder / "agent.json").read_text())
    net = Cloned(settings["n_features"], settings["chunk"], settings["width"])
    net.load_state_dict(load_file(folder / "agent.safetensors"))
    return net.eval(), settings


def acting(net: Cloned, execute: int) -> Act:
    """An agent for one episode: ``execute`` of the predicted actions are carried out, then it looks again."""
    queue: list[np.ndarray] = []

    def act(obs: Mapping[str, Any]) -> np.ndarray:
        if not queue:
            now = Moments.of(obs)
            with torch.inference_mode():
                said = net(now.features()).numpy()
            queue.extend((said * _UNIT + _base(now.q)).astype(np.float32)[0, :execute])
        return queue.pop(0)

    return act
