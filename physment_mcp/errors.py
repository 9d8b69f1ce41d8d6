"""The errors of the laboratory, and who reads the message of each.

PhysMentError
├─ UsageError            the command line asks for something impossible     → the operator, before serving
├─ SceneError            the scene cannot be loaded                         → the operator, before serving
├─ NotOpened             a host refuses to open an episode                  → the requesting client, as a response
└─ RefusedCall           a tool refuses a call                              → the agent, as an error result
   ├─ UnknownObject      no such object, as far as the agent may know
   ├─ NotPermitted       the attribute is withheld, or the object is read-only
   ├─ NotAvailable       the tool is disabled in this scene
   ├─ BeyondLimit        the call would exceed a limit of this scene
   ├─ NotPossible        the physics of this object does not allow it
   ├─ NoDifference       no velocity difference exists yet
   ├─ BadArgument        a value is out of bounds or has the wrong form
   ├─ Unstable           the simulation diverged and was rolled back
   └─ EpisodeOver        there is no episode, or it has ended
      └─ EpisodeGone     the episode at this address no longer exists

A refused call changes nothing. Its message is all that the agent learns.
"""

from collections.abc import Sequence

_MOST_LISTED = 16
"""Largest number of ids that a refusal lists."""
_MOST_QUOTED = 64
"""Largest number of characters of a client's text that a refusal quotes."""


def quoted(text: str, most: int = _MOST_QUOTED) -> str:
    """Quote the beginning of a client's text for a refusal, without characters that cannot be printed.

    Args:
        text: Any text.
        most: Largest number of characters between the quotes; an escaped one counts as up to ten.
    """
    shown = repr(text[:most])
    return shown if len(shown) <= most + 2 else shown[: most + 1] + shown[0]


class PhysMentError(Exception):
    """Base class of the errors that this package raises on purpose."""


class UsageError(PhysMentError):
    """A command asks for something impossible. The message is one sentence for the operator."""


class SceneError(PhysMentError):
    """A scene cannot be loaded.

    Args:
        sentence: The reason, for the operator.
        for_client: The sentence for a client, which must not learn where the packs are or what they contain.
    """

    def __init__(
        self, sentence: str, for_client: str = "this scene cannot be opened; its operator can see why"
    ) -> None:
        super().__init__(sentence)
        self.for_client = for_client


class NotOpened(PhysMentError):
    """A host does not open an episode.

    Args:
        status: HTTP status of the response.
        sentence: The reason, for the client.
    """

    def __init__(self, status: int, sentence: str) -> None:
        super().__init__(sentence)
        self.status = status


class RefusedCall(PhysMentError):
    """The laboratory refuses a call. The message says in one sentence what was wrong and what would be right."""


class UnknownObject(RefusedCall):
    """The agent knows of no object with this id."""

    def __init__(self, object_id: str, known: Sequence[str]) -> None:
        listed = ", ".join(known[:_MOST_LISTED]) or "none yet"
        more = f" and {len(known) - _MOST_LISTED} more" if len(known) > _MOST_LISTED else ""
        super().__init__(f"there is no object {quoted(object_id)}; the objects you can use are {listed}{more}")


class NotPermitted(RefusedCall):
    """The attribute is withheld, or the object is read-only."""


class NotAvailable(RefusedCall):
    """The tool is disabled in this scene."""


class BeyondLimit(RefusedCall):
    """The call would exceed a limit of the scene: force, torque, created mass, laboratory time or calls."""


class NotPossible(RefusedCall):
    """The physics of the object does not allow the call, for example because nothing lets it move."""


class NoDifference(RefusedCall):
    """No velocity difference over the last time step exists."""


class BadArgument(RefusedCall):
    """A value is out of bounds or of the wrong form."""


class Unstable(RefusedCall):
    """A value of the simulation is no longer finite; the call was rolled back."""


class EpisodeOver(RefusedCall):
    """There is no episode, or it has ended."""


class EpisodeGone(EpisodeOver):
    """There is no episode at this address any more, or there never was."""
