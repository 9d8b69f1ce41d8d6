"""Agents that play episodes. An agent receives its briefing and the results of its calls, and nothing else."""
