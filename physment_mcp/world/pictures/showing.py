"""Extracts the visible part of a model: shapes and colours of chosen geoms in the frames of their bodies.

A viewer receives these data directly; the rendering process receives them as a separate model (`picture_model`), with
bodies at the poses that the caller gives. Neither can draw anything else. A geom can be chosen only if it looks the
same in every variant of a scene (`same_parts`).
"""

import functools
import xml.etree.ElementTree as ET
from collections.abc import Collection, Generator, Iterable, Mapping, Sequence
from typing import Literal, NamedTuple

import mujoco
import numpy as np

from physment_mcp.world.loading import STATE, load
from physment_mcp.world.pictures.drawing import boxes_of, view_on
from physment_mcp.world.pictures.framing import View
from physment_mcp.world.readings import Array

_CACHED = 256
"""Number of models whose appearances are cached: the variants of a scene are compared anew for each of its seeds."""
SHAPES = frozenset(
    {
        mujoco.mjtGeom.mjGEOM_PLANE,
        mujoco.mjtGeom.mjGEOM_SPHERE,
        mujoco.mjtGeom.mjGEOM_CAPSULE,
        mujoco.mjtGeom.mjGEOM_ELLIPSOID,
        mujoco.mjtGeom.mjGEOM_CYLINDER,
        mujoco.mjtGeom.mjGEOM_BOX,
    }
)
"""Shapes that pose and size describe completely. Others are not drawn, because their vertices are not compared."""

Part = tuple[str, int]
"""Name of a body, and index of a geom among the body's geoms. Edits of the model change neither."""


def colour(model: mujoco.MjModel, geom: int) -> Array:
    """Red, green, blue and opacity (4,) of a geom, 0 to 1."""
    material = int(model.geom_matid[geom])
    return np.asarray(model.geom_rgba[geom] if material < 0 else model.mat_rgba[material], dtype=np.float64)


def appearance(model: mujoco.MjModel, data: mujoco.MjData, geom: int) -> Array:
    """Return everything that determines how a geom looks (19,), rounded to nanometres to remove rounding errors."""
    parts = (data.geom_xpos[geom], data.geom_xmat[geom], model.geom_size[geom], colour(model, geom))
    return np.round(np.concatenate(parts), 9)


def same_parts(variants: Sequence[str], found_later: Collection[str]) -> frozenset[Part]:
    """Return the geoms that look the same in every variant of a scene, on bodies at the same position.

    Args:
        variants: MJCF of the scene with the values of different seeds.
        found_later: Bodies that are hidden at the start. An agent that finds them may read their position, so only
            properties that do not depend on it are compared.

    Raises:
        SceneError: A variant does not compile.
    """
    later = frozenset(found_later)
    appearances = [_appearances(mjcf, later) for mjcf in dict.fromkeys(variants)]
    return frozenset(part for part, _ in frozenset.intersection(*appearances))


@functools.lru_cache(_CACHED)
def _appearances(mjcf: str, found_later: frozenset[str]) -> frozenset[tuple[Part, bytes]]:
    start = load(mjcf)
    model, data = start.model, mujoco.MjData(start.model)
    mujoco.mj_setState(model, data, start.state, STATE)
    mujoco.mj_forward(model, data)
    found: set[tuple[Part, bytes]] = set()
    for geom in range(model.ngeom):
        if mujoco.mjtGeom(model.geom_type[geom]) not in SHAPES:
            continue
        part = part_of(model, geom)
        if part[0] in found_later:
            local = (model.geom_pos[geom], data.geom_xmat[geom], model.geom_size[geom], colour(model, geom)[:3])
            seen = np.round(np.concatenate(local), 9)
        elif colour(model, geom)[3] > 0:
            # A viewer gets the parts in the frame of their body, so this must not depend on the seed either.
            seen = np.concatenate([appearance(model, data, geom), _frame(data, int(model.geom_bodyid[geom]))])
        else:
            continue
        # Adding 0.0 turns -0.0 into 0.0: the two are equal, but their bytes differ.
        found.add((part, bytes([int(model.geom_type[geom])]) + (seen + 0.0).tobytes()))
    return frozenset(found)


def _frame(data: mujoco.MjData, body: int) -> Array:
    """Return position and orientation of a body (12,), rounded to nanometres."""
    return np.round(np.concatenate([data.xpos[body], data.xmat[body]], dtype=np.float64), 9)


def part_of(model: mujoco.MjModel, geom: int) -> Part:
    """Identify a geom in every variant of the scene: the name of its body, and its number in the body."""
    body = int(model.geom_bodyid[geom])
    return model.body(body).name, geom - int(model.body_geomadr[body])


class ShownPart(NamedTuple):
    """A geom of a body."""

    shape: str
    """`sphere`, `box`, `capsule`, `cylinder`, `ellipsoid` or `plane`."""
    size: list[float]
    """Size in MuJoCo's convention (3,): radius and half lengths [m]; 0 for the infinite directions of a plane."""
    position: list[float]
    """Position of the centre (3,) [m]."""
    quaternion: list[float]
    """Orientation (4,) [w, x, y, z]."""
    rgba: list[float]
    """Red, green, blue and opacity (4,), 0 to 1."""


class ShownBody(NamedTuple):
    """The visible part of a body."""

    name: str
    movable: bool
    pose: Sequence[float]
    """Displayed pose: origin [m] and quaternion, 7 numbers; empty if the parts are given in the world frame."""
    parts: Sequence[ShownPart]


Frame = Literal["body", "origin", "world"]
"""The frame in which the parts of a body are given: its own, world axes about its origin, or the world frame."""


def shown_parts(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    frames: Mapping[str, Frame],
    parts: Collection[Part],
    turns: Mapping[str, Array],
    revealed: Collection[str] = (),
) -> dict[str, list[ShownPart]]:
    """Return the visible geoms by body, rounded to nanometres.

    Args:
        model: The scene.
        data: Its settled state.
        frames: Bodies to show, each with the frame of its geoms.
        parts: Geoms that may be shown.
        turns: Body → the orientation (4,) in which its geoms are shown instead of their present one.
        revealed: Bodies that are shown opaque.
    """
    found: dict[str, list[ShownPart]] = {}
    for geom, part, rgba in _seen(model, frames, parts, revealed):
        frame, turn = frames[part[0]], turns.get(part[0])
        if frame == "body":
            place, turn = model.geom_pos[geom], model.geom_quat[geom]
        else:
            origin = data.xpos[int(model.geom_bodyid[geom])] if frame == "origin" else np.zeros(3)
            place, turn = data.geom_xpos[geom] - origin, _turn(data, geom) if turn is None else turn
        shape = mujoco.mjtGeom(model.geom_type[geom]).name.removeprefix("mjGEOM_").lower()
        numbers = (_rounded(values) for values in (model.geom_size[geom], place, turn, rgba))
        found.setdefault(part[0], []).append(ShownPart(shape, *numbers))
    return found


def picture_model(bodies: Iterable[ShownBody]) -> str:
    """Write an MJCF model of the shown bodies; empty if there are none."""
    root = ET.Element("mujoco")
    world = ET.SubElement(root, "worldbody")
    for body in bodies:
        place = {"pos": _text(body.pose[:3]), "quat": _text(body.pose[3:])} if body.pose else {}
        owner = ET.SubElement(world, "body", {"name": body.name} | place)
        if body.movable:
            ET.SubElement(owner, "freejoint")
            # Nothing is simulated here, but MuJoCo refuses a body that can move and has no mass.
            ET.SubElement(owner, "inertial", pos="0 0 0", mass="1", diaginertia="1 1 1")
        for part in body.parts:
            placed = {"size": part.size, "pos": part.position, "quat": part.quaternion, "rgba": part.rgba}
            texts = {name: _text(values) for name, values in placed.items()}
            ET.SubElement(owner, "geom", {"type": part.shape, "contype": "0", "conaffinity": "0"} | texts)
    return ET.tostring(root, encoding="unicode") if len(world) else ""


def _seen(
    model: mujoco.MjModel, bodies: Collection[str], parts: Collection[Part], revealed: Collection[str]
) -> Generator[tuple[int, Part, Array]]:
    """Return index, name and colour of each geom that may be seen and is not transparent."""
    for geom in range(model.ngeom):
        part, rgba = part_of(model, geom), colour(model, geom)
        if part[0] in revealed:
            rgba = np.append(rgba[:3], 1.0)
        if part[0] in bodies and part in parts and rgba[3] > 0:
            yield geom, part, rgba


def view_of_shown(mjcf: str) -> View:
    """Return the view of a model that `picture_model` wrote."""
    model = mujoco.MjModel.from_xml_string(mjcf)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return view_on(model, boxes_of(model, data))


def fixtures(model: mujoco.MjModel, objects: Collection[str]) -> frozenset[str]:
    """Return fixed bodies that are neither objects nor parts of objects, including the world body."""
    of_objects: set[int] = set()
    for body in range(1, model.nbody):
        if model.body(body).name in objects or int(model.body_parentid[body]) in of_objects:
            of_objects.add(body)
    still = (body for body in range(model.nbody) if model.body_weldid[body] == 0 and body not in of_objects)
    return frozenset(model.body(body).name for body in still)


def turn_at_centre(model: mujoco.MjModel, data: mujoco.MjData, body: int) -> Array | None:
    """Return the orientation (4,) of a body's only geom, if its centre is the body's origin; otherwise None.

    The position of such a body determines the position of its geom, whatever its orientation.
    """
    first = int(model.body_geomadr[body])
    if int(model.body_geomnum[body]) != 1 or np.any(np.round(model.geom_pos[first], 9)):
        return None
    return _turn(data, first)


def _turn(data: mujoco.MjData, geom: int) -> Array:
    turn = np.empty(4)
    mujoco.mju_mat2Quat(turn, data.geom_xmat[geom])
    return turn


def _text(values: Iterable[float]) -> str:
    return " ".join(f"{value:.9f}" for value in _rounded(values))


def _rounded(values: Iterable[float]) -> list[float]:
    # To nanometres: smaller differences are rounding errors, which differ between seeds. 0.0 turns -0.0 into 0.0.
    return [round(float(value), 9) + 0.0 for value in values]
