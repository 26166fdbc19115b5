"""The default planner: one view of an object on a table → grasps by lateral curvature."""
