"""One episode in the laboratory: the objects that the agent knows, what it may read and do, and its answer.

Every tool accesses the world through the permission checks in this module. Contains no MCP, JSON, paths or answer keys.
"""

import logging
import math
from collections.abc import Generator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from typing import Literal, NamedTuple
from weakref import WeakKeyDictionary

import numpy as np

from physment_mcp.errors import BeyondLimit, EpisodeOver, NotPermitted, NotPossible, SceneError, UnknownObject
from physment_mcp.instruments import readout_of
from physment_mcp.scene import Scene
from physment_mcp.session_state import LabObject, SessionState
from physment_mcp.world import World
from physment_mcp.world.readings import Array
from scenes import USUAL_TIMESTEP_S, LabLimits, Permissions, PublicObject, PublicPack

logger = logging.getLogger(__name__)

Attribute = Literal["type", "density", "mass", "size", "radius", "position", "orientation", "angle", "velocity", "spin"]

MAX_SIMULATED_S = 3600.0
"""Limit on the simulated time of an episode [s], unless its scene sets a lower one."""
MAX_CREATED = 64
"""Limit on the number of objects that an episode may create."""

_PUBLIC = Permissions(
    geom_type=True, geom_density=True, body_mass=True, geom_size=True, geom_radius=True, body_pos=True, body_quat=True
)
_PERMISSION: dict[Attribute, str] = {
    "type": "geom_type",
    "density": "geom_density",
    "position": "body_pos",
    "orientation": "body_quat",
    "angle": "angle",
    "velocity": "velocity",
    "spin": "spin",
}
"""Attribute → the field of `Permissions` that alone decides whether it may be read."""
_UNLIMITED = LabLimits()


class _InitialState(NamedTuple):
    """The initial state, which all episodes of a scene share. It is never modified."""

    state: SessionState
    opening: tuple[tuple[LabObject, dict[str, object]], ...]


_INITIAL_STATES: WeakKeyDictionary[Scene, _InitialState] = WeakKeyDictionary()
"""Cache of initial states, with weak references to their scenes."""


@dataclass(slots=True)
class Session:
    """An episode: a scene, its world, and the permission checks between the agent and both."""

    scene: Scene
    world: World = field(init=False)
    state: SessionState = field(init=False)
    opening: tuple[tuple[LabObject, dict[str, object]], ...] = field(init=False)
    """The objects known at the start, with their descriptions at that time: the table of the opening prompt."""
    calls: int = 0
    """Number of tool calls so far, refused ones included; a roll-back does not reduce it."""
    counted_calls: int = 0
    """Number of tool calls without those of `answer`, for the limit of the scene."""
    max_calls: int | None = None
    """Limit on calls, refused ones included; None for no limit."""

    def __post_init__(self) -> None:
        self.world = World(self.scene.mjcf, self.scene.timestep, readout=readout_of(self.scene.public))
        public = self.scene.public
        if self.scene.timestep is None and not math.isclose(self.world.timestep, USUAL_TIMESTEP_S):
            logger.warning(
                "scene %d runs with the time step of its model, %g s; the suite has %g s (--timestep %g forces it)",
                *(public.scene_id, self.world.timestep, USUAL_TIMESTEP_S, USUAL_TIMESTEP_S),
            )
        initial = _INITIAL_STATES.get(self.scene)
        if initial is None:
            initial = _INITIAL_STATES[self.scene] = self._begin(public)
        self.state, self.opening = initial

    def _begin(self, public: PublicPack) -> _InitialState:
        bodies = set(self.world.bodies)
        missing = [listed.object_id for listed in public.objects if listed.object_id not in bodies]
        if missing:
            raise SceneError(f"scene {public.scene_id}: its XML has no body named {', '.join(missing)}")
        self.state = SessionState({listed.object_id: self._at_start(listed) for listed in public.objects})
        return _InitialState(self.state, tuple((item, self.describe(item)) for item in self.known()))

    def _at_start(self, listed: PublicObject) -> LabObject:
        return LabObject(
            listed.object_id,
            listed.name,
            body=listed.object_id,
            permissions=listed.permissions,
            start=self.world.pose(listed.object_id).position,
            known=not listed.permissions.hidden,
        )

    # Checks before a call

    @property
    def ended(self) -> bool:
        """Whether the episode has ended, by the answer or because the calls are used up."""
        return self.state.answered or (self.max_calls is not None and self.calls >= self.max_calls)

    def check_open(self) -> None:
        """Raise if the episode has ended.

        Raises:
            EpisodeOver: The answer has been given, or the calls are used up.
        """
        if self.state.answered:
            raise EpisodeOver("the episode is over: the answer has been given and no further call is possible")
        if self.ended:
            raise EpisodeOver(f"the episode is over: its {self.max_calls} calls are used up and no further is possible")

    def count_call(self, *, answers: bool) -> None:
        """Count a call before it runs.

        Args:
            answers: Whether the call gives the answer, which does not count towards the limit of the scene.

        Raises:
            BeyondLimit: The scene allows no further call except the answer.
        """
        self.calls += 1
        if answers:
            return
        if self.calls_left == 0:
            raise BeyondLimit(f"the {self.limits.calls} calls of this laboratory are used up; you can only answer now")
        self.counted_calls += 1

    # Limits

    @property
    def limits(self) -> LabLimits:
        """The limits of the scene."""
        return self.scene.public.limits or _UNLIMITED

    @property
    def calls_left(self) -> int | None:
        """Number of calls that the scene still allows besides the answer; None for no limit."""
        return None if self.limits.calls is None else max(0, self.limits.calls - self.counted_calls)

    @property
    def lab_time_left(self) -> float:
        """Simulated time that the episode may still use [s]."""
        allowed = self.limits.lab_time or MAX_SIMULATED_S
        return round(max(0.0, allowed - self.state.simulated_s), 9)

    def find(self, object_id: str) -> LabObject:
        """Return the object with this id; `1` means `object_1`.

        Raises:
            UnknownObject: The agent knows of no such object.
        """
        canonical = f"object_{object_id}" if object_id.isdecimal() else object_id
        found = self.state.objects.get(canonical)
        if found is None or not found.known:
            raise UnknownObject(object_id, [item.object_id for item in self.known()])
        return found

    def known(self) -> list[LabObject]:
        """Objects that the agent knows of, in the order in which it learned of them."""
        return [item for item in self.state.objects.values() if item.known]

    def readable(self, object_id: str, attribute: Attribute) -> LabObject:
        """Return the object with this id if the agent may read this attribute of it.

        Raises:
            UnknownObject: The agent knows of no such object.
            NotPermitted: The attribute is withheld.
        """
        found = self.find(object_id)
        if not self.may_read(found, attribute):
            raise NotPermitted(f"the {attribute} of {found.object_id} is withheld in this scene; find it by experiment")
        return found

    def may_read(self, item: LabObject, attribute: Attribute) -> bool:
        """Return whether the scene lets the agent read an attribute of an object."""
        may = item.permissions
        match attribute:
            case "size":
                return may.geom_size or (may.geom_radius and self._is_ball(item))
            case "radius":
                return may.geom_radius or (may.geom_size and self._is_ball(item))
            case "mass":
                return may.body_mass or (may.geom_density and self.may_read(item, "size"))
            case _:
                return getattr(may, _PERMISSION[attribute]) is True

    def _is_ball(self, item: LabObject) -> bool:
        """Return whether an object is a ball, whose size and radius determine each other."""
        return self.world.shape(item.body).type == "sphere"

    def movable(self, object_id: str) -> LabObject:
        """Return the object with this id if the agent may act on it and a joint lets it move.

        Raises:
            UnknownObject: The agent knows of no such object.
            NotPermitted: The object is read-only.
            NotPossible: The object is fixed to the laboratory.
        """
        found = self.unsealed(object_id)
        if not self.world.is_movable(found.body):
            raise NotPossible(f"{found.object_id} is fixed in the laboratory and cannot move")
        return found

    def unsealed(self, object_id: str) -> LabObject:
        """Return the object with this id if the agent may act on it.

        Raises:
            UnknownObject: The agent knows of no such object.
            NotPermitted: The object is read-only.
        """
        found = self.find(object_id)
        if not found.permissions.actuate:
            raise NotPermitted(f"{found.object_id} is sealed in this scene: it can be observed but not acted on")
        return found

    def obstacles(self) -> dict[str, str]:
        """Return the bodies that nothing may be placed into, each with the name that a refusal uses.

        Soft objects are omitted, because others may sink into them. Hidden objects are omitted, because a refusal would
        reveal them.
        """
        soft = self.scene.public.soft_objects
        hidden = {item.body for item in self.state.objects.values() if not item.known}
        labels = {item.body: item.object_id for item in self.known()} | {"world": "the laboratory"}
        bodies = ("world", *self.world.bodies)
        return {body: labels.get(body, "a fixture") for body in bodies if body not in hidden and body not in soft}

    # Changes of state

    def pass_time(self, duration: float) -> None:
        """Add elapsed simulated time [s]."""
        self.state = replace(self.state, simulated_s=self.state.simulated_s + duration)

    def answer(
        self, answer: object, steps: Mapping[str, object] | None = None, law: Mapping[str, object] | None = None
    ) -> None:
        """Record the answer, with the quantities and the law that the agent added to it; this ends the episode."""
        self.state = replace(self.state, answer=answer, steps=steps, law=law, answered=True)

    def add(self, object_id: str, body: str) -> None:
        """Add a created ball, which the agent knows at once."""
        position = self.world.pose(body).position
        made = LabObject(object_id, object_id, body, _PUBLIC, position, known=True, created=True)
        self.state = replace(
            self.state,
            objects={**self.state.objects, object_id: made},
            created_count=self.state.created_count + 1,
            created_mass=self.state.created_mass + self.world.mass(body),
        )

    def drop(self, object_ids: set[str]) -> None:
        """Remove deleted objects, and the joints that they were part of."""
        objects = {key: item for key, item in self.state.objects.items() if key not in object_ids}
        joined = frozenset(pair for pair in self.state.joined if not pair & object_ids)
        self._rejoin(objects, joined)

    def join(self, first: LabObject, second: LabObject) -> None:
        """Record that two objects are attached to each other."""
        self._rejoin(self.state.objects, self.state.joined | {frozenset({first.object_id, second.object_id})})

    def reveal(self) -> list[LabObject]:
        """Make all hidden objects known; returns every object that was hidden at the start."""
        objects = {key: replace(item, known=True) for key, item in self.state.objects.items()}
        self.state = replace(self.state, objects=objects)
        once_hidden = [item for item in objects.values() if item.permissions.hidden]
        for item in once_hidden:
            self.world.reveal(item.body)
        return once_hidden

    def _rejoin(self, objects: Mapping[str, LabObject], joined: frozenset[frozenset[str]]) -> None:
        attached = {object_id for pair in joined for object_id in pair}
        marked = {key: replace(item, attached=key in attached) for key, item in objects.items()}
        self.state = replace(self.state, objects=marked, joined=joined)

    # Roll-back

    @contextmanager
    def all_or_nothing(self) -> Generator[None]:
        """Restore the session and the world if the block fails or is cancelled."""
        world, state = self.world.save(), self.state
        try:
            yield
        except BaseException:
            self.world.restore(world)
            self.state = state
            raise

    # Attributes of objects

    def describe(self, item: LabObject) -> dict[str, object]:
        """Return the static attributes of an object that the agent may read, by name; withheld ones are None.

        Keys: type, density [kg/m³], mass [kg], size (full edge lengths) [m], radius [m], position [m], orientation.
        """
        shape, pose = self.world.shape(item.body), self.world.pose(item.body)
        values: dict[Attribute, object] = {
            "type": shape.type,
            "density": self.world.density(item.body),
            "mass": self.world.mass(item.body) if self.world.is_movable(item.body) else None,
            "size": None if shape.box is None else _rounded(shape.box),
            "radius": shape.radius,
            "position": _rounded(pose.position),
            "orientation": _rounded(pose.quaternion),
        }
        return {name: value if self.may_read(item, name) else None for name, value in values.items()}


def _rounded(values: Array) -> list[float]:
    # Decimals beyond the twelfth are rounding errors. Adding 0.0 turns -0.0 into 0.0.
    return [float(value) + 0.0 for value in np.round(values, 12)]
