"""The version of the distribution, for code that must not import the public names of the package."""

__version__ = "0.1.0"
