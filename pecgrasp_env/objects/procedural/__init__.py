"""Classes of objects that are drawn by seed."""
