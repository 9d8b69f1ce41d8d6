"""Agents: what plays an episode. Each knows the briefing and the returns it got, and nothing else."""
