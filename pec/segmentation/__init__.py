"""A class for every point of a table's cloud: `PointSegmenter.load(directory).label(points)`."""

from pec.segmentation.segmenter import PointSegmenter

__all__ = ["PointSegmenter"]
