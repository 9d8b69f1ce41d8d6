"""Generates documentation pages from the packs: the table of scenes with pictures, and the worked examples."""
