"""PhysMent for NeMo Gym: a session is an episode, each tool is an endpoint, and a referee gives the reward."""

from importlib.metadata import version

_TESTED = "0.4"

if version("nemo-gym").split(".")[:2] != _TESTED.split("."):
    raise ImportError(
        f"physment-nemo-gym is tested with nemo-gym {_TESTED} and not with {version('nemo-gym')}:"
        f" pip install 'nemo-gym=={_TESTED}.*'"
    )
