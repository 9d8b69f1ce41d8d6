"""Agents: who plays an episode. Each knows its briefing and what its calls returned, and nothing else."""
