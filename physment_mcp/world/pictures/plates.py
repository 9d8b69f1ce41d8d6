"""Plates: large images of scenes for readers, with sky and ground, soft shadows, axes, a scale bar and labels.

Agents get the small images of `drawing`. Like that module, this one needs a separate process.
"""

import contextlib
from collections.abc import Collection, Generator, Mapping, Sequence
from dataclasses import dataclass, replace

import mujoco
import numpy as np

from physment_mcp.world.pictures.annotations import Optics, annotate
from physment_mcp.world.pictures.drawing import GeomBox, boxes_of, free_camera, placed, staged, started, unlit, view_on
from physment_mcp.world.pictures.framing import FIELD_DEG, View
from physment_mcp.world.pictures.overlay import Overlay, Pixels
from physment_mcp.world.readings import Array

WIDTH, HEIGHT = 960, 640
SKY, GROUND = (0.80, 0.88, 0.97), (0.93, 0.94, 0.955)
"""Colours of the background: red, green and blue, 0 to 1."""
_GRID = (0.80, 0.825, 0.86)
_SUN = np.array((0.45, 0.5, -1.0))
"""Direction of the light: from the left, the front and above."""
_SUN_SPREAD = 0.06
"""Radius of the sun as a tangent."""


@dataclass(frozen=True, slots=True)
class Ground:
    """A grid on the ground that is not part of the scene."""

    height: float
    """Height of the grid [m]."""
    cell: float
    """Edge length of a cell [m]."""


class Studio:
    """A model with lights and a fixed camera, from which images are rendered.

    Args:
        mjcf: The visible bodies, written by `picture_model`.
        view: What the camera shows.
        ground: The grid; None if the scene has a floor.
    """

    def __init__(self, mjcf: str, view: View, ground: Ground | None) -> None:
        self._model = _decorated(mjcf, ground)
        self._data = started(self._model)
        self._view = view
        self._model.stat.extent, self._model.stat.center[:] = view.extent, view.centre
        self._surface = mujoco.GLContext(WIDTH, HEIGHT)
        self._surface.make_current()
        self._context = mujoco.MjrContext(self._model, mujoco.mjtFontScale.mjFONTSCALE_100)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, self._context)
        self._scene = mujoco.MjvScene(self._model, maxgeom=10_000)

    def place(self, poses: Mapping[str, Sequence[float]]) -> None:
        """Put bodies at poses: position [m] and quaternion, 7 numbers."""
        placed(self._model, self._data, poses)

    def shoot(self, count: int) -> Pixels:
        """Render the model (HEIGHT, WIDTH, 3).

        Args:
            count: Number of frames that are averaged. Each has a different light position and subpixel shift, which
                gives soft shadows and smooth edges.
        """
        mujoco.mjv_updateScene(
            self._model,
            self._data,
            mujoco.MjvOption(),
            None,
            free_camera(self._view),
            mujoco.mjtCatBit.mjCAT_ALL,
            self._scene,
        )
        flags = self._scene.flags
        flags[mujoco.mjtRndFlag.mjRND_SHADOW] = flags[mujoco.mjtRndFlag.mjRND_SKYBOX] = 1
        flags[mujoco.mjtRndFlag.mjRND_HAZE] = 1
        return _mean_frame(self._scene, self._context, self._view, count)

    def close(self) -> None:
        """Free the resources of the graphics library."""
        self._context.free()
        self._surface.free()


def _mean_frame(scene: mujoco.MjvScene, context: mujoco.MjrContext, view: View, count: int) -> Pixels:
    area, sun = mujoco.MjrRect(0, 0, WIDTH, HEIGHT), scene.lights[scene.nlight - 1]
    pixels = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
    total = np.zeros((HEIGHT, WIDTH, 3))
    still = [(eye.frustum_center, eye.frustum_bottom, eye.frustum_top) for eye in scene.camera]
    for place, direction in enumerate(_sun_directions(count)):
        sun.dir[:], sun.pos[:] = direction, view.centre - 8 * view.extent * direction
        # Multiples of two irrational numbers cover a pixel evenly.
        across, up = (place * 0.7548776662) % 1 - 0.5, (place * 0.5698402910) % 1 - 0.5
        for eye, (centre, bottom, top) in zip(scene.camera, still, strict=True):
            pixel = (top - bottom) / HEIGHT
            eye.frustum_center = centre + across * pixel
            eye.frustum_bottom, eye.frustum_top = bottom + up * pixel, top + up * pixel
        mujoco.mjr_render(area, scene, context)
        mujoco.mjr_readPixels(pixels, None, area, context)
        total += pixels
    return np.round(total[::-1] / count).astype(np.uint8)


def _sun_directions(count: int) -> Generator[Array]:
    """Return unit vectors that are evenly distributed over a disc (sunflower arrangement)."""
    ahead = _SUN / np.linalg.norm(_SUN)
    aside = np.cross(ahead, (0.0, 0.0, 1.0))
    aside /= np.linalg.norm(aside)
    for place in range(count):
        angle, radius = place * np.pi * (3 - np.sqrt(5)), _SUN_SPREAD * np.sqrt((place + 0.5) / count)
        moved = ahead + radius * (np.cos(angle) * aside + np.sin(angle) * np.cross(ahead, aside))
        yield moved / np.linalg.norm(moved)


def _decorated(mjcf: str, ground: Ground | None) -> mujoco.MjModel:
    """Add sky, sun and grid to the scene; the grid is the last geom, so other indices do not change."""
    spec = unlit(mjcf)
    spec.add_texture(
        name="plate_sky",
        type=mujoco.mjtTexture.mjTEXTURE_SKYBOX,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_GRADIENT,
        rgb1=SKY,
        rgb2=GROUND,
        width=256,
        height=256,
    )
    last = spec.worldbody.add_body(name="plate_grid")
    last.add_light(
        name="plate_sun",
        type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL,
        castshadow=True,
        diffuse=[0.55] * 3,
        ambient=[0] * 3,
    )
    if ground is not None:
        spec.add_texture(
            name="plate_lines",
            type=mujoco.mjtTexture.mjTEXTURE_2D,
            builtin=mujoco.mjtBuiltin.mjBUILTIN_FLAT,
            mark=mujoco.mjtMark.mjMARK_EDGE,
            rgb1=GROUND,
            markrgb=_GRID,
            width=256,
            height=256,
        )
        paint = spec.add_material(name="plate_paint", texuniform=True, texrepeat=[1 / ground.cell] * 2)
        paint.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = "plate_lines"
        paint.specular = 0
        last.add_geom(
            type=mujoco.mjtGeom.mjGEOM_PLANE,
            size=[0, 0, 1],
            pos=[0, 0, ground.height],
            material="plate_paint",
            contype=0,
            conaffinity=0,
        )
    model = spec.compile()
    model.vis.headlight.ambient[:], model.vis.headlight.diffuse[:] = 0.45, 0.27
    model.vis.headlight.specular[:] = 0.05
    model.vis.rgba.haze[:] = (*SKY, 1)
    model.vis.quality.shadowsize, model.vis.quality.offsamples = 4096, 0
    # MuJoCo draws no shadows beyond this many extents. Shadows are frayed at that border, so it is outside the image.
    model.vis.map.shadowclip = 4
    model.vis.global_.fovy = FIELD_DEG
    model.vis.quality.numslices, model.vis.quality.numstacks = 96, 48
    model.vis.global_.offwidth, model.vis.global_.offheight = WIDTH, HEIGHT
    return model


ROOM = 1.18
"""Factor on the camera's distance that leaves room for labels."""
_FRAMES = 24
"""Number of frames that are averaged."""
_CELLS = 9.0
"""Smallest number of cells of the ground grid across the image."""
_MOST = 6
"""Largest number of names in a line."""
NO_FLOOR = "the grid is no part of the scene"
"""Note below an image whose grid is not part of the scene."""


def plate(mjcf: str, labels: Mapping[str, str], notes: Sequence[str] = ()) -> Pixels:
    """Render the plate of a model (HEIGHT, WIDTH, 3).

    Args:
        mjcf: The visible bodies, written by `picture_model`; not empty.
        labels: Body → its label, which is beside it, or in a line of labels if it is not drawn.
        notes: Further lines of text at the upper edge.
    """
    model, data = staged(mjcf)
    boxes = boxes_of(model, data)
    found = view_on(model, boxes, WIDTH / HEIGHT)
    view = replace(found, distance=found.distance * ROOM)
    optics = Optics(view, WIDTH, HEIGHT)
    ground = ground_below(model, boxes, optics)
    named = named_corners(model, boxes, labels)
    inside = {name: corners for name, corners in named.items() if optics.shows(corners)}
    absent = [label for name, label in labels.items() if name not in inside]
    lines = [f"not shown: {_listed(absent)}"] if absent else []
    if ground is not None:
        lines.append(NO_FLOOR)
    overlay = Overlay(WIDTH, HEIGHT)
    annotate(overlay, optics, {labels[name]: corners for name, corners in inside.items()}, [*lines, *notes])
    with contextlib.closing(Studio(mjcf, view, ground)) as studio:
        return overlay.over(studio.shoot(_FRAMES))


def _listed(names: Sequence[str]) -> str:
    """Join names in a line; if there are many, the last ones are replaced by their number."""
    return ", ".join(names) if len(names) <= _MOST else f"{', '.join(names[:_MOST])} and {len(names) - _MOST} more"


def named_corners(model: mujoco.MjModel, boxes: Sequence[GeomBox], objects: Collection[str]) -> dict[str, Array]:
    """Return, for each object, the corners of its drawn geoms."""
    found: dict[str, list[Array]] = {}
    for geom, corners, _ in boxes:
        name = model.body(int(model.geom_bodyid[geom])).name
        if name in objects:
            found.setdefault(name, []).append(corners)
    return {name: np.concatenate(parts) for name, parts in found.items()}


def ground_below(model: mujoco.MjModel, boxes: Sequence[GeomBox], optics: Optics) -> Ground | None:
    """Return the position of the grid; None if the scene has a visible floor.

    Args:
        model: The model.
        boxes: Boxes of its geoms, at one moment or at several.
        optics: The projection.
    """
    endless = [box for box in boxes if model.geom_rbound[box.geom] <= 0]
    if any(box.is_level for box in endless):
        return None
    view = optics.view
    lowest, gap = np.inf, 0.0
    for geom, corners, _ in boxes:
        # Parts far outside the picture do not decide: the grid would be out of sight.
        bounded = model.geom_rbound[geom] > 0
        inside = float(np.abs(corners.mean(axis=0) - view.centre).max()) < 2 * view.extent
        if bounded and inside and corners[:, 2].min() < lowest:
            lowest = float(corners[:, 2].min())
            # What can move hangs over the grid; what is fixed may stand on it.
            moves = model.body_weldid[model.geom_bodyid[geom]] != 0
            gap = min(0.12 * view.extent, 0.25 * float(np.ptp(corners[:, 2]))) if moves else 0.0
    if not np.isfinite(lowest):
        lowest = float(view.centre[2])
    across = optics.width / optics.pixels_per_metre
    # Slightly lower, so that faces that lie in the grid do not flicker through it.
    return Ground(lowest - gap - 1e-3 * view.extent, across / _CELLS)
