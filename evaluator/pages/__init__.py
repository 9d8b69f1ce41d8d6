"""Generates documentation pages from the packs: the list of scenes with pictures, and the worked examples."""
