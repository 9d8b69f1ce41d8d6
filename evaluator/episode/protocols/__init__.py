"""Formats in which calls are written: JSON in prose, and typed commands of a person."""
