"""One episode in the laboratory: which objects the agent knows, what it may read and do, and how it ended.

Every tool reaches the world through the gates here. Knows no MCP, no JSON, no paths and no answers.
"""

from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from physment_mcp.errors import EpisodeOver, NotPermitted, NotPossible, SceneError, UnknownObject
from physment_mcp.scene import Scene
from physment_mcp.world import World
from physment_mcp.world.readings import Array
from scenes import Permissions

Attribute = Literal["type", "density", "mass", "size", "radius", "position", "orientation", "velocity"]

MAX_SIMULATED_S = 3600.0
"""Simulated time an episode may use [s]."""
MAX_CREATED = 64
"""Objects an episode may create."""

_PUBLIC = Permissions(
    geom_type=True, geom_density=True, body_mass=True, geom_size=True, geom_radius=True, body_pos=True, body_quat=True
)


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


@dataclass(slots=True)
class Session:
    """An episode: a scene, its world, and the gates between the agent and both."""

    scene: Scene
    world: World = field(init=False)
    objects: dict[str, LabObject] = field(init=False)
    joined: frozenset[frozenset[str]] = frozenset()
    """Pairs of ids joined by `attach_objects`."""
    opening: tuple[tuple[LabObject, dict[str, object]], ...] = field(init=False)
    """The objects known at the start and what they looked like then: the table of the opening prompt."""
    simulated_s: float = 0.0
    created_count: int = 0
    calls: int = 0
    """Tool calls so far, refused ones included."""
    max_calls: int | None = None
    """Calls the episode may use, refused ones included; None for no limit."""
    answer: object = None
    over: bool = False

    def __post_init__(self) -> None:
        self.world = World(self.scene.mjcf)
        bodies = set(self.world.bodies)
        missing = [listed.object_id for listed in self.scene.objects if listed.object_id not in bodies]
        if missing:
            raise SceneError(f"scene {self.scene.scene_id}: its XML has no body named {', '.join(missing)}")
        self.objects = {
            listed.object_id: LabObject(
                listed.object_id,
                listed.name,
                body=listed.object_id,
                permissions=listed.permissions,
                start=self.world.pose(listed.object_id).position,
                known=not listed.permissions.hidden,
            )
            for listed in self.scene.objects
        }
        self.opening = tuple((one, self.describe(one)) for one in self.known())

    # Gates

    @property
    def ended(self) -> bool:
        """True after the answer, and when the calls are used up."""
        return self.over or (self.max_calls is not None and self.calls >= self.max_calls)

    def check_open(self) -> None:
        """Refuse everything after the end."""
        if self.over:
            raise EpisodeOver("the episode is over: the answer has been given and no further call is possible")
        if self.ended:
            raise EpisodeOver(f"the episode is over: its {self.max_calls} calls are used up and no further is possible")

    def find(self, object_id: str) -> LabObject:
        """The object of this id, `1` meaning `object_1`.

        Raises:
            UnknownObject: There is none the agent knows of.
        """
        canonical = f"object_{object_id}" if object_id.isdecimal() else object_id
        found = self.objects.get(canonical)
        if found is None or not found.known:
            raise UnknownObject(object_id, (one.object_id for one in self.known()))
        return found

    def known(self) -> list[LabObject]:
        """Objects the agent knows of, in the order in which it met them."""
        return [one for one in self.objects.values() if one.known]

    def readable(self, object_id: str, attribute: Attribute) -> LabObject:
        """The object, if the agent may read this attribute of it.

        Raises:
            UnknownObject: There is none the agent knows of.
            NotPermitted: The attribute is withheld.
        """
        found = self.find(object_id)
        if not self.may_read(found, attribute):
            raise NotPermitted(f"the {attribute} of {found.object_id} is withheld in this scene; find it by experiment")
        return found

    def may_read(self, one: LabObject, attribute: Attribute) -> bool:
        """Whether the scene lets the agent read an attribute of an object."""
        may = one.permissions
        match attribute:
            case "size":
                return may.geom_size or (may.geom_radius and self._is_ball(one))
            case "radius":
                return may.geom_radius or (may.geom_size and self._is_ball(one))
            case "mass":
                return may.body_mass or (may.geom_density and self.may_read(one, "size"))
            case _:
                return {
                    "type": may.geom_type,
                    "density": may.geom_density,
                    "position": may.body_pos,
                    "orientation": may.body_quat,
                    "velocity": may.velocity,
                }[attribute]

    def _is_ball(self, one: LabObject) -> bool:
        """Whether size and radius say the same of it."""
        return self.world.shape(one.body).type == "sphere"

    def movable(self, object_id: str) -> LabObject:
        """The object, if the agent may act on it and anything lets it move.

        Raises:
            UnknownObject: There is none the agent knows of.
            NotPermitted: It is sealed.
            NotPossible: It is fixed to the laboratory.
        """
        found = self.unsealed(object_id)
        if not self.world.is_movable(found.body):
            raise NotPossible(f"{found.object_id} is fixed in the laboratory and cannot move")
        return found

    def unsealed(self, object_id: str) -> LabObject:
        """The object, if the agent may act on it.

        Raises:
            UnknownObject: There is none the agent knows of.
            NotPermitted: It is sealed.
        """
        found = self.find(object_id)
        if not found.permissions.actuate:
            raise NotPermitted(f"{found.object_id} is sealed in this scene: it can be observed but not acted on")
        return found

    def obstacles(self) -> dict[str, str]:
        """Bodies nothing may be placed into, and what to call them: what the agent can see, and nothing soft.

        Hidden objects are left out: a refusal would give them away.
        """
        soft, hidden = self.scene.soft_objects, {one.body for one in self.objects.values() if not one.known}
        labels = {one.body: one.object_id for one in self.known()} | {"world": "the laboratory"}
        bodies = ("world", *self.world.bodies)
        return {body: labels.get(body, "a fixture") for body in bodies if body not in hidden and body not in soft}

    # Changes of the set of objects

    def add(self, object_id: str, body: str, position: Array) -> LabObject:
        """Make a created ball known."""
        made = LabObject(object_id, object_id, body, _PUBLIC, position, known=True, created=True)
        self.objects = {**self.objects, object_id: made}
        self.created_count += 1
        return made

    def drop(self, object_ids: set[str]) -> None:
        """Forget removed objects and the joints they were part of."""
        self.objects = {key: one for key, one in self.objects.items() if key not in object_ids}
        self._rejoin(frozenset(pair for pair in self.joined if not pair & object_ids))

    def join(self, first: LabObject, second: LabObject) -> None:
        """Note that two objects are now one assembly."""
        self._rejoin(self.joined | {frozenset({first.object_id, second.object_id})})

    def reveal(self) -> list[LabObject]:
        """Make all hidden objects known, and return those that ever were hidden."""
        self.objects = {key: replace(one, known=True) for key, one in self.objects.items()}
        once_hidden = [one for one in self.objects.values() if one.permissions.hidden]
        for one in once_hidden:
            self.world.reveal(one.body)
        return once_hidden

    def _rejoin(self, joined: frozenset[frozenset[str]]) -> None:
        self.joined = joined
        tied = {object_id for pair in joined for object_id in pair}
        self.objects = {key: replace(one, attached=key in tied) for key, one in self.objects.items()}

    # Roll-back

    @contextmanager
    def all_or_nothing(self) -> Generator[None]:
        """Put everything back as it was if the block fails or is cancelled."""
        world = self.world.save()
        mine = (self.objects, self.joined, self.simulated_s, self.created_count, self.answer, self.over)
        try:
            yield
        except BaseException:
            self.world.restore(world)
            self.objects, self.joined, self.simulated_s, self.created_count, self.answer, self.over = mine
            raise

    # What an object looks like

    def describe(self, one: LabObject) -> dict[str, object]:
        """The permitted static attributes of an object, by name; a withheld one is None.

        Keys: type, density [kg/m³], mass [kg], size (full edge lengths) [m], radius [m], position [m], orientation.
        """
        shape, pose = self.world.shape(one.body), self.world.pose(one.body)
        values: dict[Attribute, object] = {
            "type": shape.type,
            "density": self.world.density(one.body),
            "mass": self.world.mass(one.body) if self.world.is_movable(one.body) else None,
            "size": None if shape.box is None else _rounded(shape.box),
            "radius": shape.radius,
            "position": _rounded(pose.position),
            "orientation": _rounded(pose.quaternion),
        }
        return {name: value if self.may_read(one, name) else None for name, value in values.items()}


def _rounded(values: Array) -> list[float]:
    # Twelve decimals: what differs beyond them is arithmetic noise. Adding 0.0 turns -0.0 into 0.0.
    return [float(value) + 0.0 for value in np.round(values, 12)]
