"""Clouds, regions and grasps as figures to turn around, in a page that loads nothing from elsewhere."""
