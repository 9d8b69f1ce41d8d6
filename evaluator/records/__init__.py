"""Frozen records of episodes and runs, and the key of held-back seeds."""
