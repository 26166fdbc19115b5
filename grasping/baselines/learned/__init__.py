"""Grasps that a sampler proposes and a learned function judges; neither needs torch here."""
