"""Calibration: the difficulty of scenes and the ability of agents on one scale, with standard errors."""
