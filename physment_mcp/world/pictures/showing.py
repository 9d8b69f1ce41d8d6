"""What may be seen of a model, for who draws it: shapes, places and colours of chosen geoms, and nothing else.

The process that draws pictures receives them as a model of their own, a viewer as parts of bodies. Neither can draw
anything else.
"""

import xml.etree.ElementTree as ET
from collections.abc import Collection, Generator, Iterable, Mapping
from typing import Literal, NamedTuple

import mujoco
import numpy as np

from physment_mcp.world.pictures.drawing import Visible, view_on
from physment_mcp.world.pictures.framing import View
from physment_mcp.world.pictures.looks import Part, colour, part_of
from physment_mcp.world.readings import Array


class ShownPart(NamedTuple):
    """A geom of a body."""

    shape: str
    """`sphere`, `box`, `capsule`, `cylinder`, `ellipsoid` or `plane`."""
    size: list[float]
    """As MuJoCo has it (3,): radius and half lengths [m]; 0 for the endless directions of a plane."""
    position: list[float]
    """Of its centre (3,) [m]."""
    quaternion: list[float]
    """Its orientation (4,) [w, x, y, z]."""
    rgba: list[float]
    """Red, green, blue and opacity (4,), 0 to 1."""


Frame = Literal["body", "origin", "world"]
"""The frame in which the parts of a body are given: its own, world axes about its origin, or that of the world."""


def shown_parts(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    frames: Mapping[str, Frame],
    parts: Collection[Part],
    turns: Mapping[str, Array],
    revealed: Collection[str] = (),
) -> dict[str, list[ShownPart]]:
    """The geoms that may be seen, by body, rounded to nanometres.

    Args:
        model: The scene.
        data: Its settled state.
        frames: Bodies whose geoms are shown, as far as these are among the parts, with the frame to give them in.
        parts: As for `shown_model`.
        turns: As for `shown_model`.
        revealed: As for `shown_model`.
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


def shown_model(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    bodies: Collection[str],
    parts: Collection[Part],
    turns: Mapping[str, Array],
    revealed: Collection[str] = (),
) -> str:
    """MJCF of some geoms where they are now; empty if all of them are transparent.

    Args:
        model: The scene.
        data: Its settled state.
        bodies: Bodies whose geoms are shown, as far as these are among the parts.
        parts: Geoms that may be shown.
        turns: For some bodies, the orientation in which their geoms are shown instead of their own: quaternions (4,).
        revealed: Bodies that are shown opaque.
    """
    root = ET.Element("mujoco")
    world = ET.SubElement(root, "worldbody")
    owners: dict[str, ET.Element] = {"world": world}
    shown = 0
    for geom, part, rgba in _seen(model, bodies, parts, revealed):
        if part[0] not in owners:
            owners[part[0]] = ET.SubElement(world, "body", name=part[0])
            if model.body_weldid[model.geom_bodyid[geom]] != 0:
                ET.SubElement(owners[part[0]], "freejoint")
                ET.SubElement(owners[part[0]], "inertial", pos="0 0 0", mass="1", diaginertia="1 1 1")
        turn = turns.get(part[0])
        if turn is None:
            turn = _turn(data, geom)
        ET.SubElement(
            owners[part[0]],
            "geom",
            type=mujoco.mjtGeom(model.geom_type[geom]).name.removeprefix("mjGEOM_").lower(),
            size=_text(model.geom_size[geom]),
            pos=_text(data.geom_xpos[geom]),
            quat=_text(turn),
            rgba=_text(rgba),
            contype="0",
            conaffinity="0",
        )
        shown += 1
    return ET.tostring(root, encoding="unicode") if shown else ""


def _seen(
    model: mujoco.MjModel, bodies: Collection[str], parts: Collection[Part], revealed: Collection[str]
) -> Generator[tuple[int, Part, Array]]:
    """Index, name and colour of each geom that may be seen and is not transparent."""
    for geom in range(model.ngeom):
        part, rgba = part_of(model, geom), colour(model, geom)
        if part[0] in revealed:
            rgba = np.append(rgba[:3], 1.0)
        if part[0] in bodies and part in parts and rgba[3] > 0:
            yield geom, part, rgba


def view_of_shown(mjcf: str) -> View:
    """The view of a model that `shown_model` wrote."""
    model = mujoco.MjModel.from_xml_string(mjcf)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return view_on(model, data, Visible(tuple(range(model.ngeom)), ()))


def fixtures(model: mujoco.MjModel, objects: Collection[str]) -> frozenset[str]:
    """Fixed bodies that are neither objects nor parts of objects; the world itself is one of them."""
    of_objects: set[int] = set()
    for body in range(1, model.nbody):
        if model.body(body).name in objects or int(model.body_parentid[body]) in of_objects:
            of_objects.add(body)
    still = (body for body in range(model.nbody) if model.body_weldid[body] == 0 and body not in of_objects)
    return frozenset(model.body(body).name for body in still)


def turn_at_centre(model: mujoco.MjModel, data: mujoco.MjData, body: int) -> Array | None:
    """Orientation (4,) of the only geom of a body, if its centre is the body's origin; None otherwise.

    The position of such a body says where all of it is, however it is turned.
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
