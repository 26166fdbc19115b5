"""The pose of a known object, regressed from its cloud: `PoseRegressor.load(directory).propose(points, name)`."""

from pec.pose.regressor import PoseProposals, PoseRegressor

__all__ = ["PoseProposals", "PoseRegressor"]
