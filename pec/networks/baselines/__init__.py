"""Classifiers that PEC is measured against, each in one file, all of them on the same few points."""

from pec.networks.baselines.dgcnn import DGCNN
from pec.networks.baselines.forest import Forest
from pec.networks.baselines.knn import NearestNeighbours
from pec.networks.baselines.memorising import Memorising
from pec.networks.baselines.pointmlp import PointMLPElite
from pec.networks.baselines.pointnet import PointNet, VanillaPointNet
from pec.networks.baselines.pointnet2 import PointNet2

__all__ = [
    "DGCNN",
    "Forest",
    "Memorising",
    "NearestNeighbours",
    "PointMLPElite",
    "PointNet",
    "PointNet2",
    "VanillaPointNet",
]
