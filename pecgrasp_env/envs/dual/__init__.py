"""DualGrasp-v1: two arms, one long or heavy thing."""
