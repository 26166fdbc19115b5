"""Labelled clouds: shards on disk, splits, and the tensors that training reads."""
