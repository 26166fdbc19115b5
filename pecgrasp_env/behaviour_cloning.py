"""An example of an agent that learns from recorded demonstrations: behaviour cloning on the state observation.

A small network takes where the arm, the gripper and the asked-for object are, and says the next few actions of the
control mode `pd_joint_delta_pos` ("action chunking", Zhao et al. 2023); the first of them are carried out before it
looks again. It is trained on the expert's actions with an L1 loss, and evaluated in episodes of its own beside agents
that idle and act at random. Read it from `train` on; `pecgrasp_env.demonstrations` makes what it learns from.
"""

from __future__ import annotations

import json
import os
import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import gymnasium as gym
import h5py  # type: ignore[import-untyped]
import numpy as np
import torch
from mani_skill.trajectory.dataset import load_h5_data
from mani_skill.utils.geometry.rotation_conversions import quaternion_to_matrix
from safetensors.torch import load_file, save_file
from torch import nn
from torch.utils.tensorboard import SummaryWriter

from pecgrasp_env.agent_evaluation import Act, acting_at_random, evaluate, idling, show

CONTROL_MODE = "pd_joint_delta_pos"


class CloningError(ValueError):
    """The demonstrations cannot be learnt from; the message says why."""


@dataclass(frozen=True)
class CloningConfig:
    """demos: trajectory.h5 of `record_demos`. out: folder of results.json, agent.safetensors, agent.json, tensorboard.

    chunk, execute: actions that are predicted, and carried out before the next look. width: of two hidden layers.
    noise: deviation of what is added to the standardised features, so that small errors are met in training.
    held_out: share of the episodes whose loss is only watched. evaluate_every: epochs. episodes: of each evaluation on
    the way, from first_seed on; final_episodes: of the last one and of the two others, from final_seed on, looked at
    once. most_steps: of an episode of evaluation.
    """

    demos: str
    out: str
    epochs: int = 400
    batch: int = 256
    learning_rate: float = 1e-3
    width: int = 256
    chunk: int = 8
    execute: int = 4
    noise: float = 0.02
    held_out: float = 0.1
    evaluate_every: int = 100
    episodes: int = 20
    first_seed: int = 600000
    final_episodes: int = 100
    final_seed: int = 700000
    most_steps: int = 150
    seed: int = 0


class Cloned(nn.Module):
    """Features (N, F) → the next actions (N, chunk, 8), each in [-1, 1]."""

    mean: torch.Tensor
    deviation: torch.Tensor

    def __init__(self, n_features: int, chunk: int, width: int) -> None:
        super().__init__()
        self.register_buffer("mean", torch.zeros(n_features))
        self.register_buffer("deviation", torch.ones(n_features))
        self.layers = nn.Sequential(
            *(nn.Linear(n_features, width), nn.GELU(), nn.Linear(width, width), nn.GELU(), nn.Linear(width, chunk * 8))
        )

    def forward(self, features: torch.Tensor, noise: float = 0.0) -> torch.Tensor:
        standard = (features - self.mean) / self.deviation
        standard = standard + noise * torch.randn_like(standard) if noise else standard
        return self.layers(standard).unflatten(1, (-1, 8)).tanh()


def features(obs: Mapping[str, Any]) -> torch.Tensor:
    """(N, 30) of an observation of the mode `state_dict`, or of a recorded episode as N of them.

    Arm joints, target opening, opening, force, tool position, object position, the object from the tool, both rotations
    as the first two columns of their matrices: quaternions jump.
    """
    agent, extra = obs["agent"], obs["extra"]
    tool, thing = (torch.as_tensor(extra[name]) for name in ("tcp_pose", "target_pose"))
    turned = [quaternion_to_matrix(pose[:, 3:])[:, :, :2].flatten(1) for pose in (tool, thing)]
    target_opening = torch.as_tensor(agent["controller"]["gripper"]["target_opening"])
    gripper = [target_opening, torch.as_tensor(extra["opening"]), torch.as_tensor(extra["force"])]
    places = [tool[:, :3], thing[:, :3], thing[:, :3] - tool[:, :3]]
    return torch.cat([torch.as_tensor(agent["qpos"])[:, :6], *gripper, *places, *turned], dim=1)


def read_demonstrations(path: Path, chunk: int) -> tuple[list[tuple[torch.Tensor, torch.Tensor]], dict[str, Any]]:
    """Of each episode the features (T, F) and the next actions (T, chunk, 8), the last one repeated beyond its end; and
    the arguments of the environment.

    Raises CloningError where the file holds no episodes, or those of another control mode.
    """
    info = json.loads(path.with_suffix(".json").read_text())
    if not info["episodes"]:
        raise CloningError(f"{path}: holds no episodes")
    episodes = []
    with h5py.File(path) as file:
        for episode in info["episodes"]:
            if episode["control_mode"] != CONTROL_MODE:
                raise CloningError(f"{path}: control mode {episode['control_mode']}, must be {CONTROL_MODE}")
            trajectory = load_h5_data(file[f"traj_{episode['episode_id']}"])
            actions = torch.from_numpy(trajectory["actions"])
            following = torch.arange(len(actions))[:, None] + torch.arange(chunk)
            episodes.append((features(trajectory["obs"])[:-1], actions[following.clamp(max=len(actions) - 1)]))
    return episodes, info["env_info"]["env_kwargs"]


def train(config: CloningConfig) -> dict[str, Any]:
    """Learn and evaluate; returns what is written to OUT/results.json. A finished run is not repeated."""
    out = Path(config.out)
    if (out / "results.json").exists() and json.loads((out / "results.json").read_text())["config"] == asdict(config):
        return json.loads((out / "results.json").read_text())
    torch.manual_seed(config.seed)
    demonstrations, env_kwargs = read_demonstrations(Path(config.demos), config.chunk)
    n_held_out = int(len(demonstrations) * config.held_out)
    learnt, watched = demonstrations[n_held_out:], demonstrations[:n_held_out]
    inputs, wanted = (torch.cat(parts) for parts in zip(*learnt, strict=True))
    net = Cloned(inputs.shape[1], config.chunk, config.width)
    net.mean, net.deviation = inputs.mean(dim=0), inputs.std(dim=0).clamp_min(1e-3)
    optimizer = torch.optim.AdamW(net.parameters(), lr=config.learning_rate)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, config.epochs)
    cloned = partial(acting, net, config.execute)
    env = gym.make("SelectiveGrasp-v1", **env_kwargs)
    began, curve = time.monotonic(), []
    with SummaryWriter(str(out / "tensorboard" / "cloned")) as writer:
        for epoch in range(1, config.epochs + 1):
            total = 0.0
            for rows in torch.randperm(len(inputs)).split(config.batch):
                loss = (net(inputs[rows], config.noise) - wanted[rows]).abs().mean()
                optimizer.zero_grad()
                loss.backward()
                optimizer.step()
                total += float(loss.detach()) * len(rows)
            schedule.step()
            losses = {"train": total / len(inputs)}
            if watched:
                with torch.inference_mode():
                    losses["held_out"] = float(np.mean([float((net(x) - y).abs().mean()) for x, y in watched]))
            for name, value in losses.items():
                writer.add_scalar(f"loss/{name}", value, epoch)
            if epoch % config.evaluate_every == 0 or epoch == 1:
                seeds = range(config.first_seed, config.first_seed + config.episodes)
                measured = evaluate(env, cloned, seeds, config.most_steps)
                curve.append({"epoch": epoch, "loss": losses, **measured})
                show(writer, measured, epoch)
    learning_s = time.monotonic() - began
    save_file(net.state_dict(), out / "agent.safetensors.tmp")
    os.replace(out / "agent.safetensors.tmp", out / "agent.safetensors")
    _write_json(out / "agent.json", {**asdict(config), "n_features": inputs.shape[1], "env_kwargs": env_kwargs})
    seeds = range(config.final_seed, config.final_seed + config.final_episodes)
    generator = torch.Generator().manual_seed(config.seed)
    agents: dict[str, Callable[[], Act]] = {
        "cloned": cloned,
        "idle": idling,
        "random": partial(acting_at_random, generator),
    }
    final = {name: evaluate(env, agent, seeds, config.most_steps) for name, agent in agents.items()}
    env.close()
    for name, measured in final.items():
        with SummaryWriter(str(out / "tensorboard" / f"{name}_final")) as writer:
            for epoch in (1, config.epochs):  # a level line beside the curve
                show(writer, measured, epoch)
    results = {"demonstrations": len(learnt), "samples": len(inputs), "curve": curve, "final": final}
    results |= {"learning_s": learning_s, "seconds": time.monotonic() - began, "config": asdict(config)}
    _write_json(out / "results.json", results)
    return results


def load(folder: Path) -> tuple[Cloned, dict[str, Any]]:
    """The network that `train` left in a folder, and the settings beside it, `env_kwargs` among them."""
    settings = json.loads((folder / "agent.json").read_text())
    net = Cloned(settings["n_features"], settings["chunk"], settings["width"])
    net.load_state_dict(load_file(folder / "agent.safetensors"))
    return net.eval(), settings


def acting(net: Cloned, execute: int) -> Act:
    """An agent for one episode: ``execute`` of the predicted actions are carried out, then it looks again."""
    queue: list[torch.Tensor] = []

    def act(obs: Mapping[str, Any]) -> torch.Tensor:
        if not queue:
            with torch.inference_mode():
                queue.extend(net(features(obs))[0, :execute])
        return queue.pop(0)

    return act


def _write_json(path: Path, content: Any) -> None:
    temporary = path.with_name(f"{path.name}.{os.getpid()}.tmp")
    temporary.write_text(json.dumps(content, indent=1))
    os.replace(temporary, path)
