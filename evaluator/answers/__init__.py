"""Answers: parsing, answer keys, and grading."""
