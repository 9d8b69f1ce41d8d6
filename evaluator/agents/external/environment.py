"""What an external program sees of our environment."""

import os
from collections.abc import Mapping
from pathlib import Path

from scenes import default_folder

_OWN_VARIABLES = {"PWD", "OLDPWD", "PYTHONPATH", "PYTHONHOME", "VIRTUAL_ENV", "CONDA_PREFIX", "_"}
_OWN_PREFIXES = ("PHYSMENT", "PYTEST", "XDG_")
URL = "PHYSMENT_MCP_URL"
"""Environment variable in which a program finds the address of its episode."""
TOKEN = "PHYSMENT_MCP_TOKEN"  # noqa: S105 - a name, not a token
"""Environment variable in which it finds the bearer token for this address, if one is needed."""


def child_environment(ours: Mapping[str, str], scenes_dir: Path | None) -> dict[str, str]:
    """An environment that does not reveal where the packs and this program are.

    Args:
        ours: The environment to start from.
        scenes_dir: The packs played; None for the suite.
    """
    folders = [str(folder) for folder in (scenes_dir and scenes_dir.absolute(), default_folder().parent) if folder]

    def names_a_folder(value: str) -> bool:
        return any(folder in value for folder in folders)

    path = os.pathsep.join(part for part in ours.get("PATH", os.defpath).split(os.pathsep) if not names_a_folder(part))
    kept = {
        name: value
        for name, value in ours.items()
        if name not in _OWN_VARIABLES and not name.startswith(_OWN_PREFIXES) and not names_a_folder(value)
    }
    return kept | {"PATH": path}
