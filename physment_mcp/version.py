"""Versions of this package and of MuJoCo, in a module of its own, so that every other module can import it."""

__version__ = "0.2.0"
"""Version of the distribution `physment-mcp`; the only place that holds it."""


def engine_version() -> str:
    """Return the installed version of MuJoCo, without loading it."""
    from importlib.metadata import version  # noqa: PLC0415 - only one option asks, and every start would load it

    return version("mujoco")
