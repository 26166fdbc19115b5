"""Labelled frames of crowded tables: what a segmenter of touching, leaning and stacked things learns from."""
