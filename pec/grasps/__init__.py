"""Grasps that were tried: their labels on disk, and networks that learn from them to judge and to propose grasps."""

from pec.grasps.proposer import GraspProposer
from pec.grasps.scorer import GraspScorer

__all__ = ["GraspProposer", "GraspScorer"]
