"""Detects six failure modes in a recorded episode, each with evidence."""
