"""The command `pecgrasp`: what the packages do, started from a terminal. `pecgrasp --help` lists it."""
