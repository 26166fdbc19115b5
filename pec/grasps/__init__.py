"""Grasps that were tried: their labels on disk, and what learns from them."""
