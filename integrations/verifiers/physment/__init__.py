"""PhysMent's laboratory for verifiers: the taskset `physment` of `vf-eval`, `vf-validate` and of trainers."""

from importlib.metadata import version

_TESTED = "0.4"

if version("verifiers").split(".")[:2] != _TESTED.split("."):
    raise ImportError(
        f"physment-verifiers is tested with verifiers {_TESTED} and not with {version('verifiers')}:"
        f" pip install 'verifiers=={_TESTED}.*'"
    )

from physment.taskset import PhysmentEnv, PhysmentTaskset  # noqa: E402 - it needs the version that is checked above

__all__ = ["PhysmentEnv", "PhysmentTaskset"]
