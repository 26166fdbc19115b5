"""Two grasps for two hands on one long or heavy object, so that their lift balances its weight."""
