"""A model that contains only what may be seen: shapes, places and colours of chosen geoms.

The process that draws receives only this model, so it cannot draw anything else.
"""

import xml.etree.ElementTree as ET
from collections.abc import Collection, Iterable, Mapping

import mujoco
import numpy as np

from physment_mcp.world.pictures.drawing import Visible, view_on
from physment_mcp.world.pictures.framing import View
from physment_mcp.world.pictures.looks import Part, colour, part_of
from physment_mcp.world.readings import Array


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
    for geom in range(model.ngeom):
        part = part_of(model, geom)
        rgba = [*colour(model, geom)[:3], 1.0] if part[0] in revealed else colour(model, geom)
        if part[0] not in bodies or part not in parts or rgba[3] <= 0:
            continue
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
    # To nanometres: smaller differences are rounding errors, which differ between seeds.
    return " ".join(f"{round(float(value), 9) + 0.0:.9f}" for value in values)
