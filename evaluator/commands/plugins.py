"""What other distributions add to this program, found by their entry points when a command asks for it."""

from importlib.metadata import entry_points
from typing import Any

from evaluator.errors import UsageError

COMMANDS_GROUP = "physment_eval.commands"
"""Group of commands. An entry point is a function that gets the parser of its command, adds options and sets `run`."""
EXPORTS_GROUP = "physment_eval.exports"
"""Group of formats of `export`. An entry point is a function of a folder, the record of a run, and its episodes with
their grades; it writes files into the folder and returns their paths."""


def plugin(group: str, name: str, words: str) -> Any:
    """The function behind an entry point of one of our plugins, which are in `integrations/`.

    Args:
        group: Of the entry point.
        name: Its name, and that of its folder.
        words: The command that needs it.

    Raises:
        UsageError: The plugin is not installed, or cannot be imported.
    """
    for found in entry_points(group=group, name=name):
        try:
            return found.load()
        except ImportError as error:
            raise UsageError(f"{words}: the plugin {found.value} cannot be imported: {error}") from error
    raise UsageError(
        f"{words} needs the plugin physment-{name}, which is not installed: in a checkout,"
        f" pip install ./integrations/{name}"
    )
