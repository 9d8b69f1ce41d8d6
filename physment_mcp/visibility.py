"""The visibility rule: which bodies an agent may see. It applies to images of every kind, to the viewer and to films.

A part is drawn if it looks the same in every variant of the scene, and belongs to a fixture, or to a known object whose
type, size and position the agent may read. A movable object whose orientation the agent may not read is drawn with its
orientation at the start, and only if its position determines the positions of all its parts. So the only attribute that
an agent may see but not read is the start orientation of such an object, or of an immovable one. This orientation is
the same in every variant. Objects are drawn at the poses that the instruments read. A renderer receives only these
parts and poses.
"""

import functools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from physment_mcp.scene import Scene, load_variants
from physment_mcp.session import LabObject, Session
from physment_mcp.world import Pose, World
from physment_mcp.world.pictures.showing import Frame, Part, ShownBody, ShownPart, same_parts
from physment_mcp.world.readings import Array

_CACHED = 64
"""Number of scenes in the cache of visibilities."""
_METRES, _QUATERNION = 6, 5
"""Number of decimals of positions [m] and of quaternions; further ones would make no visible difference."""
_UPRIGHT = (1.0, 0.0, 0.0, 0.0)
_MARKER_M, _MARKER_SHARE = 0.05, 0.035
"""Radius of a marker if nothing else is drawn [m]; otherwise, share of the largest distance between drawn items."""
_MARKER_COLOUR = (0.55, 0.6, 0.68, 0.55)


class Visible(NamedTuple):
    """The bodies and geoms that may be seen at one moment."""

    objects: tuple[LabObject, ...]
    fixtures: frozenset[str]
    """Names of fixed bodies that are not objects."""
    parts: frozenset[Part]
    """Geoms that may be drawn, of fixtures and of objects."""
    turns: Mapping[str, Array]
    """Body → the orientation (4,), as a quaternion, in which its geom is drawn instead of its present one."""

    @property
    def bodies(self) -> frozenset[str]:
        """Names of all bodies that may be seen."""
        return frozenset(item.body for item in self.objects) | self.fixtures


@dataclass(frozen=True, slots=True)
class Visibility:
    """The result of the visibility rule for a scene at its start."""

    parts: frozenset[Part]
    fixtures: frozenset[str]
    turns: Mapping[str, Array]

    def now(self, session: Session) -> Visible:
        """Return the bodies and geoms that may be seen at this moment of an episode.

        Args:
            session: The session of the episode.
        """
        objects = tuple(item for item in session.known() if self._may_show(session, item))
        made = {(item.body, 0) for item in objects if item.created}
        return Visible(objects, self.fixtures, self.parts | made, self.turns)

    def _may_show(self, session: Session, item: LabObject) -> bool:
        may = session.may_read
        placed = may(item, "orientation") or item.body in self.turns or not session.world.is_movable(item.body)
        return placed and may(item, "type") and may(item, "size") and may(item, "position")


def visibility_of(scene: Scene, variants: Sequence[str]) -> Visibility:
    """Apply the visibility rule to a scene.

    Args:
        scene: The scene.
        variants: The scene's MJCF at other seeds, so many that every property that depends on the seed differs in at
            least one.

    Raises:
        SceneError: A variant does not compile.
    """
    listed, start = scene.public.objects, World(scene.mjcf, scene.timestep)
    hidden = {item.object_id for item in listed if item.permissions.hidden}
    parts = same_parts((*variants, scene.mjcf), hidden)
    return Visibility(parts, start.fixtures({item.object_id for item in listed}), _start_turns(scene, start))


def _start_turns(scene: Scene, start: World) -> dict[str, Array]:
    """Return the start orientation of each movable body whose present orientation is withheld; images show it."""
    withheld = (item.object_id for item in scene.public.objects if not item.permissions.body_quat)
    turns = {body: start.turn_at_centre(body) for body in withheld if start.is_movable(body)}
    return {body: turn for body, turn in turns.items() if turn is not None}


def cached_visibility(scenes_dir: Path | None) -> Callable[[Scene], Visibility]:
    """Create a cached function that returns the visibility of a scene in a folder.

    The function raises SceneError if the folder lacks variants of the scene, such as an export of a single seed.
    """

    @functools.lru_cache(_CACHED)
    def find(scene: Scene) -> Visibility:
        return visibility_of(scene, load_variants(scene.public.scene_id, scenes_dir))

    return find


def bodies_of(session: Session, visible: Visible) -> list[ShownBody]:
    """The visible bodies with their visible parts; fixtures come first.

    Objects are named by their ids. Fixtures are numbered, because their names in the model may reveal private facts; a
    colon in the name separates them from names chosen by agents. Shapes are in body frames and poses are readings, so
    no position is more precise than the result of `get_position`.
    """
    frames: dict[str, Frame] = dict.fromkeys(visible.fixtures, "world")
    frames |= {item.body: "body" if session.may_read(item, "orientation") else "origin" for item in visible.objects}
    shown = session.world.shown_parts(frames, visible.parts, visible.turns)
    fixtures = [parts for body, parts in shown.items() if body in visible.fixtures]
    found = [ShownBody(f"fixture:{number}", False, (), parts) for number, parts in enumerate(fixtures, 1)]
    for item in visible.objects:
        # The position of an object with no visible part may depend on the seed.
        if item.body in shown:
            pose = pose_numbers(session, item, session.world.pose(item.body))
            found.append(ShownBody(item.object_id, session.world.is_movable(item.body), pose, shown[item.body]))
    return found


def pose_numbers(session: Session, item: LabObject, pose: Pose) -> list[float]:
    """Position [m] and quaternion of an object as 7 numbers; the identity rotation if its orientation is withheld."""
    turn = pose.quaternion if session.may_read(item, "orientation") else _UPRIGHT
    position = [round(float(value), _METRES) + 0.0 for value in pose.position]
    return position + [round(float(value), _QUATERNION) + 0.0 for value in turn]


def markers_at_start(session: Session, visibility: Visibility) -> list[ShownBody]:
    """Spheres at the start positions of objects that must not be drawn but whose position may be read.

    Only objects with the same start position in every variant get a marker. The markers reveal no shape or size: their
    radius depends only on the distances between drawn items.
    """
    visible = visibility.now(session)
    drawn, known = bodies_of(session, visible), session.known()
    named = {body.name for body in drawn}
    marked = {
        item.object_id: pose_numbers(session, item, session.world.pose(item.body))
        for item in known
        if item.object_id not in named and session.may_read(item, "position") and (item.body, 0) in visible.parts
    }
    places = np.array([*(body.pose[:3] for body in drawn if body.pose), *(pose[:3] for pose in marked.values())])
    radius = _MARKER_SHARE * float(np.ptp(places, axis=0).max()) if len(places) > 1 else 0.0
    sphere = ShownPart("sphere", [radius or _MARKER_M, 0.0, 0.0], [0.0] * 3, list(_UPRIGHT), list(_MARKER_COLOUR))
    return [ShownBody(name, True, (*pose[:3], *_UPRIGHT), [sphere]) for name, pose in marked.items()]
