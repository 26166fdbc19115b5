"""Demonstrations of the scripted policy, and an agent that learns from them."""
