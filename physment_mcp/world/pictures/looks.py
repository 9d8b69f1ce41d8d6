"""How geoms look at the start of a scene, and which of them look the same in every variant of it."""

from collections.abc import Collection, Sequence

import mujoco
import numpy as np

from physment_mcp.world.loading import STATE, load
from physment_mcp.world.readings import Array

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


def look(model: mujoco.MjModel, data: mujoco.MjData, geom: int) -> Array:
    """Everything that decides how a geom looks (19,), to nanometres: smaller differences are rounding errors."""
    parts = (data.geom_xpos[geom], data.geom_xmat[geom], model.geom_size[geom], colour(model, geom))
    return np.round(np.concatenate(parts), 9)


def same_parts(variants: Sequence[str], found_later: Collection[str]) -> frozenset[Part]:
    """Geoms that look the same in every variant of a scene, on bodies that are at the same place.

    Args:
        variants: MJCF of the scene with the values of different seeds.
        found_later: Bodies that are hidden at the start. An agent that finds them may read where they are, so only
            what does not depend on their place is compared.

    Raises:
        SceneError: A variant does not compile.
    """
    looks = [_looks(mjcf, found_later) for mjcf in dict.fromkeys(variants)]
    return frozenset(part for part, _ in frozenset.intersection(*looks))


def _looks(mjcf: str, found_later: Collection[str]) -> frozenset[tuple[Part, bytes]]:
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
            seen = np.concatenate([look(model, data, geom), _frame(data, int(model.geom_bodyid[geom]))])
        else:
            continue
        # Adding 0.0 turns -0.0 into 0.0: the two are equal, but their bytes differ.
        found.add((part, bytes([int(model.geom_type[geom])]) + (seen + 0.0).tobytes()))
    return frozenset(found)


def _frame(data: mujoco.MjData, body: int) -> Array:
    """Place and orientation of a body (12,), to nanometres."""
    return np.round(np.concatenate([data.xpos[body], data.xmat[body]], dtype=np.float64), 9)


def part_of(model: mujoco.MjModel, geom: int) -> Part:
    """How a geom is named in every model of the scene."""
    body = int(model.geom_bodyid[geom])
    return model.body(body).name, geom - int(model.body_geomadr[body])
