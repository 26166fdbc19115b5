"""How long each step takes, beside a yardstick in the same run."""
