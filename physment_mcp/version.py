"""The version, in a module of its own: code of this package must not import the public names."""

__version__ = "0.1.0"
"""Version of the distribution `physment-mcp`."""
