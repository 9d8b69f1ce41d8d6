"""The errors of this package: a pack that cannot be used, and a world that cannot be made."""

from pathlib import Path


class PackError(Exception):
    """A scene pack is missing or malformed; the message is a sentence for the operator."""

    def __init__(self, where: Path, problem: str) -> None:
        super().__init__(f"{where}: {problem}")
        self.where = where
        self.problem = problem


class WorldError(Exception):
    """A world cannot be made or read; the message is a sentence for the user."""
