"""Grasp labels that make themselves: grasps on an object, tried by many hands in one physics scene."""
