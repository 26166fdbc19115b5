"""Exact depth of objects, drawn one by one or many at a time."""
