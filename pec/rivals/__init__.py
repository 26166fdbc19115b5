"""Classifiers that PEC is measured against, each in one file, all of them on the same few points."""

from pec.rivals.dgcnn import DGCNN
from pec.rivals.knn import NearestNeighbours
from pec.rivals.pointmlp import PointMLPElite
from pec.rivals.pointnet import PointNet, VanillaPointNet
from pec.rivals.pointnet2 import PointNet2

__all__ = ["DGCNN", "NearestNeighbours", "PointMLPElite", "PointNet", "PointNet2", "VanillaPointNet"]
