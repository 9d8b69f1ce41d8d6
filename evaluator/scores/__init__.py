"""Scores: numbers computed from single episodes, from groups of episodes, and from runs."""
