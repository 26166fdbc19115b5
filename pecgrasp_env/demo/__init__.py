"""The whole chain in one go: clouds, a classifier, episodes, a film and a report."""
