"""The documentation as a website: which files become pages, how they are joined, what a built site must fulfil.

Not part of the wheel. Only `conf.py` concerns Sphinx, which reads it; the rest needs nothing but the standard library,
so that the tests of this package run without Sphinx.
"""
