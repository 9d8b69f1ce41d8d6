"""Builds the documentation website: selects the pages, rewrites their links, adds navigation, checks the result.

Not part of the wheel. Only Sphinx reads `conf.py`; the other modules need only the standard library, so that the tests
of this package run without Sphinx.
"""
