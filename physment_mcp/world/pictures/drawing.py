"""Renders models off-screen with its own lights and backdrop, antialiasing, and a camera that frames visible bodies.

Use it in a separate process: a missing or broken graphics library may crash the process that loads it, and MuJoCo
selects the library when it is imported, by the environment variable MUJOCO_GL.
"""

from collections.abc import Collection, Mapping, Sequence
from typing import NamedTuple

import mujoco
import numpy as np

from physment_mcp.world.pictures.framing import AZIMUTH_DEG, ELEVATION_DEG, FIELD_DEG, FramedParts, View, view_of
from physment_mcp.world.pictures.overlay import Pixels
from physment_mcp.world.readings import Array

WIDTH, HEIGHT = 320, 240
_FINER = 2
"""Pixels rendered per pixel of the image, in each direction; their mean antialiases edges."""
_WHITE = (1.0, 1.0, 1.0)
_LARGE = 12.0
"""An object this many times larger than any movable one counts as surroundings, such as a floor."""
_FAR = 60.0
"""A view this many times wider than the smallest movable object would show it too small; farther objects are
omitted."""
_LEVEL = 0.7
"""Smallest vertical component of the z axis of a geom that points upwards."""
_NOTHING = View(np.zeros(3), 4.0, 2.0)
"""View of a model without geoms."""


def staged(mjcf: str) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """Return a model written by `picture_model`, in its initial state and lit by a headlight."""
    spec = unlit(mjcf)
    spec.add_texture(
        name="backdrop",
        type=mujoco.mjtTexture.mjTEXTURE_SKYBOX,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_FLAT,
        rgb1=_WHITE,
        rgb2=_WHITE,
        width=8,
        height=8,
    )
    model = spec.compile()
    model.vis.headlight.ambient[:], model.vis.headlight.diffuse[:] = 0.45, 0.5
    model.vis.headlight.specular[:] = 0.1
    model.vis.global_.fovy = FIELD_DEG
    model.vis.global_.offwidth, model.vis.global_.offheight = WIDTH * _FINER, HEIGHT * _FINER
    return model, started(model)


def unlit(mjcf: str) -> mujoco.MjSpec:
    """Return the spec of a model with its lights off."""
    spec = mujoco.MjSpec.from_string(mjcf)
    for light in spec.lights:
        light.active = False
    return spec


def placed(model: mujoco.MjModel, data: mujoco.MjData, poses: Mapping[str, Sequence[float]]) -> None:
    """Put bodies of a model written by `picture_model` at poses: position [m] and quaternion, 7 numbers."""
    for name, pose in poses.items():
        body = model.body(name)
        joint = int(body.jntadr[0])
        if joint >= 0:
            start = int(model.jnt_qposadr[joint])
            data.qpos[start : start + 7] = pose
        else:
            body.pos[:], body.quat[:] = pose[:3], pose[3:]
    mujoco.mj_forward(model, data)


def started(model: mujoco.MjModel) -> mujoco.MjData:
    """Return the initial state of a model."""
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return data


class GeomBox(NamedTuple):
    """Bounding box of a geom at one moment."""

    geom: int
    corners: Array
    """Corners (8, 3), world axes [m]; 2 m long along infinite directions."""
    is_level: bool
    """Whether the z axis of the geom points upwards."""


def boxes_of(model: mujoco.MjModel, data: mujoco.MjData) -> list[GeomBox]:
    """Return the boxes of all geoms."""
    return [
        GeomBox(geom, corners_of(model, data, geom), bool(data.geom_xmat[geom][8] > _LEVEL))
        for geom in range(model.ngeom)
    ]


class Extras(NamedTuple):
    """Additional items that a view must frame, besides the objects of the model."""

    made: Collection[str] = ()
    """Names of objects that an agent has made."""
    marks: Sequence[Array] = ()
    """Corners (8, 3) of boxes around movable objects that the model does not contain [m]."""
    points: Sequence[Array] = ()
    """Further points (n, 3) [m]."""


NO_EXTRAS = Extras()


def view_on(
    model: mujoco.MjModel,
    boxes: Sequence[GeomBox],
    aspect: float = WIDTH / HEIGHT,
    extras: Extras = NO_EXTRAS,
) -> View:
    """Return the view that frames a model.

    Args:
        model: The model.
        boxes: Boxes of its geoms, at one moment or at several.
        aspect: Width of the image over its height.
        extras: Additional items that the view must frame.
    """
    if not boxes and not extras.marks and not extras.points:
        return _NOTHING
    return view_of(_subject(model, boxes, extras), aspect)


def free_camera(view: View) -> mujoco.MjvCamera:
    """Return a camera with a view."""
    camera = mujoco.MjvCamera()
    camera.type = mujoco.mjtCamera.mjCAMERA_FREE
    camera.azimuth, camera.elevation, camera.distance = AZIMUTH_DEG, ELEVATION_DEG, view.distance
    camera.lookat[:] = view.centre
    return camera


def drawn(model: mujoco.MjModel, data: mujoco.MjData, view: View) -> Pixels:
    """Render a staged model from a view (HEIGHT, WIDTH, 3)."""
    model.stat.extent, model.stat.center[:] = view.extent, view.centre
    with mujoco.Renderer(model, HEIGHT * _FINER, WIDTH * _FINER) as renderer:
        renderer.update_scene(data, free_camera(view))
        fine = renderer.render().astype(np.float64)
    blocks = fine.reshape(HEIGHT, _FINER, WIDTH, _FINER, 3)
    return np.round(blocks.mean(axis=(1, 3))).astype(np.uint8)


def check_renderer() -> None:
    """Render a test image; if that is impossible, raises the error of the graphics library."""
    model, data = staged('<mujoco><worldbody><geom size="1"/></worldbody></mujoco>')
    drawn(model, data, _NOTHING)


def _subject(model: mujoco.MjModel, boxes: Sequence[GeomBox], extras: Extras) -> FramedParts:
    """Return the corners of the bounding boxes of the main objects, and of each part of the surroundings."""
    made, marks, points = extras
    # An unbounded plane has no bounding box; it is drawn behind the rest.
    bounded = [box for box in boxes if model.geom_rbound[box.geom] > 0] or list(boxes)
    names = {box.geom: model.body(model.geom_bodyid[box.geom]).name for box in bounded}
    objects = [box for box in bounded if names[box.geom].startswith("object_") or names[box.geom] in made]
    named = objects if objects or marks or points else bounded
    moving = [_size(box.corners) for box in named if model.body_weldid[model.geom_bodyid[box.geom]] != 0]
    moving += [_size(mark) for mark in marks]
    largest, farthest = (_LARGE * max(moving), _FAR * min(moving)) if moving else (np.inf, np.inf)
    parts = [*(box.corners for box in named if _size(box.corners) <= largest), *marks, *points]
    things, kept = _near(parts, farthest), {box.geom for box in named}
    surroundings = [box.corners for box in bounded if box.geom not in kept or _size(box.corners) > largest]
    return FramedParts(things, surroundings, max(moving) if moving else _size(things))


def _near(parts: Sequence[Array], farthest: float) -> Array:
    """Join the nearest other parts to the first part, while the extent of all stays within `farthest` [m]."""
    lows, highs = (np.array([bound(part, axis=0) for part in parts]) for bound in (np.min, np.max))
    low, high, chosen = lows[0], highs[0], [0]
    left = list(range(1, len(parts)))
    while left:
        sizes = (np.maximum(highs[left], high) - np.minimum(lows[left], low)).max(axis=1)
        nearest = int(np.argmin(sizes))
        if sizes[nearest] > farthest:
            break
        chosen.append(left.pop(nearest))
        low, high = np.minimum(low, lows[chosen[-1]]), np.maximum(high, highs[chosen[-1]])
    return np.concatenate([parts[place] for place in chosen])


def _size(corners: Array) -> float:
    return float(np.ptp(corners, axis=0).max())


def corners_of(model: mujoco.MjModel, data: mujoco.MjData, geom: int) -> Array:
    """Return the corners (8, 3) of a geom's bounding box, world axes [m]; 2 m long along infinite directions."""
    box = model.geom_aabb[geom]
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    local = box[:3] + signs * np.where(box[3:] > 0, box[3:], 1.0)
    return data.geom_xpos[geom] + local @ data.geom_xmat[geom].reshape(3, 3).T
