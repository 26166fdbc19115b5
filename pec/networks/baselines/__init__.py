"""Classifiers that PEC is measured against, each in one file, all of them on the same few points."""

from pec.networks.baselines.curvenet import CurveNet
from pec.networks.baselines.dgcnn import DGCNN
from pec.networks.baselines.forest import Forest
from pec.networks.baselines.gdanet import GDANet
from pec.networks.baselines.knn import NearestNeighbours
from pec.networks.baselines.memorising import Memorising
from pec.networks.baselines.pointcnn import PointCNN
from pec.networks.baselines.pointmlp import PointMLPElite
from pec.networks.baselines.pointnet import PointNet, VanillaPointNet
from pec.networks.baselines.pointnet2 import PointNet2
from pec.networks.baselines.slnet import SLNetS

__all__ = [
    "DGCNN",
    "CurveNet",
    "Forest",
    "GDANet",
    "Memorising",
    "NearestNeighbours",
    "PointCNN",
    "PointMLPElite",
    "PointNet",
    "PointNet2",
    "SLNetS",
    "VanillaPointNet",
]
