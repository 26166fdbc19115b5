"""From a raw cloud to the few ordered points that a network takes."""
