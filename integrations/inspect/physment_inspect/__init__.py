# The optional library is not in the environment in which types are checked.
# pyright: reportUnknownVariableType=false
"""PhysMent for Inspect AI: the task `physment_inspect/physment`, and the format `inspect` of `physment-eval export`."""

from physment_inspect.task import physment

__all__ = ["physment"]
