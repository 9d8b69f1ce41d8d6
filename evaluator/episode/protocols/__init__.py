"""Formats of calls: JSON lists in prose, written by models, and commands typed by a person."""
