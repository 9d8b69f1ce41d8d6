"""Renders models off-screen with own light and backdrop, antialiasing, and a camera that frames the visible bodies.

Use it in a separate process: a missing or broken graphics library may crash the process that loads it, and MuJoCo
selects the library when it is imported, by the environment variable MUJOCO_GL.
"""

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


def staged(mjcf: str) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """Return a model written by `picture_model`, in its initial state with own light."""
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


def started(model: mujoco.MjModel) -> mujoco.MjData:
    """Return the initial state of a model."""
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return data


def view_on(model: mujoco.MjModel, data: mujoco.MjData, aspect: float = WIDTH / HEIGHT) -> View:
    """Return the view that frames a model, which must not be empty; `aspect` is the width over the height."""
    return view_of(_subject(model, data), aspect)


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
    drawn(model, data, View(np.zeros(3), 4.0, 2.0))


def _subject(model: mujoco.MjModel, data: mujoco.MjData) -> FramedParts:
    """Return the corners of the bounding boxes of the main objects, and of each part of the surroundings."""
    # An unbounded plane has no bounding box; it is drawn behind the rest.
    bounded = [geom for geom in range(model.ngeom) if model.geom_rbound[geom] > 0] or list(range(model.ngeom))
    boxes = {geom: corners_of(model, data, geom) for geom in bounded}
    named = [geom for geom in bounded if model.body(model.geom_bodyid[geom]).name.startswith("object_")] or bounded
    moving = [_size(boxes[geom]) for geom in named if model.body_weldid[model.geom_bodyid[geom]] != 0]
    largest, farthest = (_LARGE * max(moving), _FAR * min(moving)) if moving else (np.inf, np.inf)
    parts = [boxes[geom] for geom in named if _size(boxes[geom]) <= largest]
    things = parts.pop(0)
    while parts:
        grown = [np.concatenate([things, part]) for part in parts]
        nearest = min(range(len(parts)), key=lambda place: _size(grown[place]))
        if _size(grown[nearest]) > farthest:
            break
        things = grown[nearest]
        parts.pop(nearest)
    surroundings = [boxes[geom] for geom in bounded if geom not in named or _size(boxes[geom]) > largest]
    return FramedParts(things, surroundings, max(moving) if moving else _size(things))


def _size(corners: Array) -> float:
    return float(np.ptp(corners, axis=0).max())


def corners_of(model: mujoco.MjModel, data: mujoco.MjData, geom: int) -> Array:
    """Return the corners (8, 3) of a geom's bounding box, world axes [m]; 2 m long along infinite directions."""
    box = model.geom_aabb[geom]
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    local = box[:3] + signs * np.where(box[3:] > 0, box[3:], 1.0)
    return data.geom_xpos[geom] + local @ data.geom_xmat[geom].reshape(3, 3).T
