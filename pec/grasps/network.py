"""The networks by name, and the settings that each is made from."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TypeAlias

import torch

from pec.common.settings import one_of
from pec.errors import ConfigError
from pec.grasps.hand import Hand
from pec.grasps.networks.gpd import GPD
from pec.grasps.networks.graspnet_evaluator import GraspNetEvaluator
from pec.grasps.networks.graspnet_sampler import GraspNetSampler
from pec.grasps.networks.pointnetgpd import PointNetGPD
from pec.grasps.views import GraspViews
from pec.training.costs import counted_multiply_adds

__all__ = ["EVALUATORS", "NETWORKS", "GraspNetwork", "NetworkConfig", "build_network", "multiply_adds"]

GraspNetwork: TypeAlias = GPD | PointNetGPD | GraspNetEvaluator | GraspNetSampler

EVALUATORS = ("gpd", "pointnetgpd", "graspnet_evaluator")
"""Those that judge grasps."""

NETWORKS = (*EVALUATORS, "graspnet_sampler")


@dataclass(frozen=True)
class NetworkConfig:
    """name: of NETWORKS. cloud_points: of the object's cloud, by farthest point sampling. n_points: that the network
    reads: of PointNetGPD between the fingers, of GraspNet's on the object. image_size: pixels of GPD's pictures. share:
    of the published widths; GPD has its own. hand: the gripper."""

    name: str = "pointnetgpd"
    cloud_points: int = 512
    n_points: int = 128
    image_size: int = 32
    share: float = 0.25
    hand: Hand = field(default_factory=Hand)

    def __post_init__(self) -> None:
        one_of("network.name", self.name, NETWORKS)
        if self.n_points < 16:
            raise ConfigError(f"network.n_points must be 16 at least, got {self.n_points}")
        if self.cloud_points < self.n_points:
            raise ConfigError(f"network.cloud_points {self.cloud_points} is less than n_points {self.n_points}")
        if not 0.05 <= self.share <= 4:
            raise ConfigError(f"network.share must be between 0.05 and 4, got {self.share}")


def build_network(config: NetworkConfig) -> GraspNetwork:
    """A new network, on the CPU. Raises ConfigError for a size that makes no sense."""
    if config.name == "gpd":
        return GPD(config.hand, config.image_size)
    if config.name == "pointnetgpd":
        return PointNetGPD(config.hand, config.n_points, config.share)
    made = GraspNetEvaluator if config.name == "graspnet_evaluator" else GraspNetSampler
    return made(config.hand, config.n_points, config.share)


def multiply_adds(network: GraspNetwork, config: NetworkConfig) -> int:
    """Of one grasp, judged or proposed, in matrix products and convolutions."""
    generator = torch.Generator().manual_seed(0)
    points = 0.02 * torch.randn(1, config.cloud_points, 3, generator=generator)
    network.eval()
    if isinstance(network, GraspNetSampler):
        sampler = network
        return counted_multiply_adds(lambda: sampler.propose(points[0], torch.zeros(1, 2)))
    judge = network
    return counted_multiply_adds(lambda: judge(GraspViews(points, points, torch.eye(4)[None])))
