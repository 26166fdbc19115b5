"""Things that are none of the classes asked for: drawn by seed, to learn from what "none of these" looks like."""
