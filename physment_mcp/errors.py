"""Everything that can go wrong in the laboratory, and who reads it.

PhysMentError
├─ UsageError            the command line asks for something impossible     → the operator, before serving
├─ SceneError            the scene cannot be loaded                         → the operator, before serving
├─ NotOpened             a host opens no episode                            → the client that asked, as a reply
└─ RefusedCall           the agent can do better: its message is all it sees → the agent, as an error result
   ├─ UnknownObject      no such object, as far as the agent may know
   ├─ NotPermitted       the attribute is withheld, or the object is sealed
   ├─ NotAvailable       the tool is disabled in this scene
   ├─ BeyondLimit        the call would go beyond a limit of this scene
   ├─ NotPossible        the laboratory cannot do that to this object
   ├─ NoDifference       no velocity difference exists yet
   ├─ BadArgument        a value is out of bounds or of the wrong form
   ├─ Unstable           the simulation blew up and was rolled back
   └─ EpisodeOver        there is no episode, or it has ended
      └─ EpisodeGone     there is none at this address any more

A refused call changes nothing.
"""

from collections.abc import Sequence

_MOST_LISTED = 16
"""Most ids that a refusal lists."""
_MOST_QUOTED = 64
"""Most characters that a refusal quotes of a text of the client."""


def quoted(text: str, most: int = _MOST_QUOTED) -> str:
    """A text of the client as a refusal quotes it: its beginning in quotes, without characters that cannot be printed.

    Args:
        text: Any text.
        most: Most characters between the quotes; an escaped one counts as up to ten.
    """
    shown = repr(text[:most])
    return shown if len(shown) <= most + 2 else shown[: most + 1] + shown[0]


class PhysMentError(Exception):
    """Root of the errors this package raises on purpose."""


class UsageError(PhysMentError):
    """A command asks for something impossible; one sentence for the operator."""


class SceneError(PhysMentError):
    """A scene cannot be loaded.

    Args:
        sentence: Why, for the operator.
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
        status: The HTTP status that says so.
        sentence: Why, for the client.
    """

    def __init__(self, status: int, sentence: str) -> None:
        super().__init__(sentence)
        self.status = status


class RefusedCall(PhysMentError):
    """A call the laboratory refuses; one sentence that says what was wrong and what would be right."""


class UnknownObject(RefusedCall):
    """The agent knows of no object with this id."""

    def __init__(self, object_id: str, known: Sequence[str]) -> None:
        listed = ", ".join(known[:_MOST_LISTED]) or "none yet"
        more = f" and {len(known) - _MOST_LISTED} more" if len(known) > _MOST_LISTED else ""
        super().__init__(f"there is no object {quoted(object_id)}; the objects you can use are {listed}{more}")


class NotPermitted(RefusedCall):
    """The attribute is withheld, or the object is sealed."""


class NotAvailable(RefusedCall):
    """The tool is disabled in this scene."""


class BeyondLimit(RefusedCall):
    """The call would go beyond a limit of the scene: force, torque, created mass, laboratory time or calls."""


class NotPossible(RefusedCall):
    """The laboratory cannot do that to this object."""


class NoDifference(RefusedCall):
    """No velocity difference over the last time step exists."""


class BadArgument(RefusedCall):
    """A value is out of bounds or of the wrong form."""


class Unstable(RefusedCall):
    """The simulation left the finite numbers; the call was rolled back."""


class EpisodeOver(RefusedCall):
    """There is no episode, or it has ended."""


class EpisodeGone(EpisodeOver):
    """There is no episode at this address any more, or there never was."""
