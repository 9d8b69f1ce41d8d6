"""The state of a session as frozen records: its objects, and what calls have changed. Contains no world."""

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
    """Position of the object's origin at the start of the episode, or where it was created (3,) [m]."""
    known: bool
    """Whether the agent knows of the object; False while it is hidden."""
    created: bool = False
    attached: bool = False
    """Whether the object is part of a pair joined by `attach_objects`."""


@dataclass(frozen=True, slots=True)
class SessionState:
    """The part of a session that calls change and a roll-back restores, except the world.

    A change replaces the whole record, so a reference to the old one is enough to restore it.
    """

    objects: Mapping[str, LabObject]
    """Every object by id, hidden ones included, in the order in which the agent learned of them."""
    joined: frozenset[frozenset[str]] = frozenset()
    """Pairs of ids joined by `attach_objects`."""
    simulated_s: float = 0.0
    created_count: int = 0
    created_mass: float = 0.0
    """Total mass of all objects created so far, deleted ones included [kg]."""
    answer: object = None
    steps: Mapping[str, object] | None = None
    """Intermediate quantities that were stated with the answer."""
    law: Mapping[str, object] | None = None
    """The law that was stated with the answer."""
    answered: bool = False
