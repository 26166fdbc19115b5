"""Axes, slabs, clusters and samples of point clouds, and arithmetic that is the same on every machine."""
