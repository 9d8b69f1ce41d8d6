"""What a session knows at one moment, as frozen records: its objects, and what calls have changed. Knows no world."""

from collections.abc import Mapping
from dataclasses import dataclass

from physment_mcp.mechanics import Array
from scenes import Permissions


@dataclass(frozen=True, slots=True)
class LabObject:
    """An object in the laboratory."""

    object_id: str
    name: str
    body: str
    permissions: Permissions
    start: Array
    """Position of its origin at the start of the episode, or where it was created (3,) [m]."""
    known: bool
    """False while hidden."""
    created: bool = False
    attached: bool = False
    """Part of a pair joined by `attach_objects`."""


@dataclass(frozen=True, slots=True)
class SessionState:
    """All of a session that calls change and a roll-back restores, besides the world.

    A change replaces the whole record, so keeping a reference to it is enough to restore it.
    """

    objects: Mapping[str, LabObject]
    """Every object by id, hidden ones too, in the order in which the agent met them."""
    joined: frozenset[frozenset[str]] = frozenset()
    """Pairs of ids joined by `attach_objects`."""
    simulated_s: float = 0.0
    created_count: int = 0
    created_mass: float = 0.0
    """Total mass of the objects created so far, deleted ones too [kg]."""
    answer: object = None
    steps: Mapping[str, object] | None = None
    """Quantities stated beside the answer."""
    answered: bool = False
