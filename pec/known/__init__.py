"""Whether a cloud is of a known class at all: what is measured of it, how that becomes one probability, new classes."""
