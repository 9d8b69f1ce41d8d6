"""The versions. They have their own module because code of this package must not import the public names."""

__version__ = "0.2.0"
"""Version of the distribution `physment-mcp`; the only place that holds it."""


def engine_version() -> str:
    """Return the installed version of MuJoCo, without loading it."""
    from importlib.metadata import version  # noqa: PLC0415 - only one option asks, and every start would load it

    return version("mujoco")
