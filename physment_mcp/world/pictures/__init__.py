"""Renders images of the visible bodies."""
