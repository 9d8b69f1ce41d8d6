"""Certification of scenes: the only package of the evaluator that may import the server's code and the engine."""
