"""What may be seen in an episode: one rule for pictures, for the viewer and for films.

A part is drawn if it looks the same in every variant of the scene, and belongs to a fixture, or to a known object whose
type, size and position the agent may read. A movable object whose orientation the agent may not read is drawn with its
orientation at the start, and only if its position says where all of it is. So the only attribute that may be seen and
not read is the orientation that such an object, or one that cannot move, has at the start of every variant. Where an
object is drawn, `views` says: where the instruments read it. Whoever draws receives only these parts and places.
"""

import functools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from physment_mcp.scene import Scene, load_variants
from physment_mcp.session import LabObject, Session
from physment_mcp.world import World
from physment_mcp.world.pictures.looks import Part, same_parts
from physment_mcp.world.readings import Array

_KEPT = 64
"""Most scenes of which a process keeps what may be seen in them."""


class Seen(NamedTuple):
    """What may be seen at one moment."""

    objects: tuple[LabObject, ...]
    fixtures: frozenset[str]
    """Fixed bodies that are no objects."""
    parts: frozenset[Part]
    """Geoms that may be drawn, of these bodies and of others."""
    turns: Mapping[str, Array]
    """Body → the orientation (4,) in which its geom is drawn instead of its own."""

    @property
    def bodies(self) -> frozenset[str]:
        """Names of all bodies that may be seen."""
        return frozenset(item.body for item in self.objects) | self.fixtures


@dataclass(frozen=True, slots=True)
class Sight:
    """What the rule says about a scene, before anything happens in an episode of it."""

    parts: frozenset[Part]
    fixtures: frozenset[str]
    turns: Mapping[str, Array]

    def seen(self, session: Session) -> Seen:
        """What may be seen now in an episode of the scene."""
        objects = tuple(item for item in session.known() if self._may_show(session, item))
        made = {(item.body, 0) for item in objects if item.created}
        return Seen(objects, self.fixtures, self.parts | made, self.turns)

    def _may_show(self, session: Session, item: LabObject) -> bool:
        may = session.may_read
        placed = may(item, "orientation") or item.body in self.turns or not session.world.is_movable(item.body)
        return placed and may(item, "type") and may(item, "size") and may(item, "position")


def sight_of(scene: Scene, variants: Sequence[str]) -> Sight:
    """Find out what may be seen in a scene.

    Args:
        scene: The scene.
        variants: Its MJCF at enough other seeds to show everything that depends on the seed.

    Raises:
        SceneError: A variant does not compile.
    """
    listed, start = scene.public.objects, World(scene.mjcf, scene.timestep)
    hidden = {item.object_id for item in listed if item.permissions.hidden}
    parts = same_parts((*variants, scene.mjcf), hidden)
    return Sight(parts, start.fixtures({item.object_id for item in listed}), _start_turns(scene, start))


def _start_turns(scene: Scene, start: World) -> dict[str, Array]:
    """Orientation at the start of the bodies that are drawn with it because their orientation is withheld."""
    withheld = (item.object_id for item in scene.public.objects if not item.permissions.body_quat)
    turns = {body: start.turn_at_centre(body) for body in withheld if start.is_movable(body)}
    return {body: turn for body, turn in turns.items() if turn is not None}


def looking(scenes_dir: Path | None) -> Callable[[Scene], Sight]:
    """What finds out what may be seen in the scenes of a folder, each once as long as it is used.

    It raises SceneError if the folder does not hold enough variants of a scene, as an export of one seed.
    """

    @functools.lru_cache(_KEPT)
    def look(scene: Scene) -> Sight:
        return sight_of(scene, load_variants(scene.public.scene_id, scenes_dir))

    return look
