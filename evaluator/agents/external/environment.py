"""What an external program sees of our environment, and what its output may show of it."""

import os
import re
from collections.abc import Mapping
from pathlib import Path

from scenes import default_folder

_OWN_VARIABLES = {"PWD", "OLDPWD", "PYTHONPATH", "PYTHONHOME", "VIRTUAL_ENV", "CONDA_PREFIX", "_"}
_SECRET_NAME = re.compile(r"KEY|TOKEN|SECRET|PASSWORD|PASSWD|CREDENTIAL", re.IGNORECASE)


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
        if name not in _OWN_VARIABLES and not name.startswith(("PHYSMENT", "PYTEST")) and not names_a_folder(value)
    }
    return kept | {"PATH": path}


def without_secrets(text: str, environment: Mapping[str, str]) -> str:
    """A text with each value of a secret environment variable replaced by the variable's name in brackets."""
    secrets = {value: name for name, value in environment.items() if _SECRET_NAME.search(name) and len(value) >= 8}
    # Longest first: a secret may contain another one.
    for value in sorted(secrets, key=len, reverse=True):
        text = text.replace(value, f"[{secrets[value]}]")
    return text
