"""Several views of one scene, merged into one cloud."""

from grasping.fusion.fuse import Fused, FusedView, fuse

__all__ = ["Fused", "FusedView", "fuse"]
