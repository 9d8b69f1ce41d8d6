"""Draws the frames of the README's film as HTML pages: the carts, rendered by MuJoCo, and the text around them.

Set MUJOCO_GL before importing this module.
"""

# MuJoCo ships no type stubs.
# pyright: reportAttributeAccessIssue=false, reportUnknownArgumentType=false, reportUnknownMemberType=false
# pyright: reportUnknownVariableType=false

import base64
import io
import re
from collections.abc import Iterator

import mujoco
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from evaluator.films.animation import animation_of
from physment_mcp.world.pictures.drawing import placed, staged
from physment_mcp.world.pictures.showing import picture_model
from tests.harness.front_page.episode import Played
from tests.harness.front_page.frames import Frame, Line, frames_of

WIDTH, HEIGHT = 800, 384
"""Size of the film [px]. On a telephone it is about half as large, so the text is large."""
STRIP_TOP, STRIP_HEIGHT, ROWS_TOP, ROW = 60, 180, 248, 44
"""Layout of the picture [px]."""
SHOWN_M, MIDDLE_M, RAIL_M = 3.2, 1.0, 0.13
"""Width of the part of the world that the strip shows, and the point in its centre: x and height [m]."""
HALF_CART_M = 0.30
"""Half the length of a cart [m]."""
SUN = (
    '<worldbody><light directional="true" dir="0.2 0.6 -1" diffuse="0.65 0.65 0.65" specular="0 0 0"'
    ' castshadow="false"/>'
)
"""Light from afar: a flat face has one colour, which compresses well, and upper faces are brighter than the front."""
DISTANCE_M = 24.0
"""Distance of the camera [m]. It is large, so that lengths in the picture are in proportion to those of the track."""
SCALE, FINE = 1.5, 3
"""Device pixel ratio of the film, and pixels rendered per pixel, in each direction."""

STYLE = """
:root { --ink: #1f2328; --soft: #59636e; --red: #cf222e; --blue: #0969da; --right: #1a7f37; --push: #9a6700; }
@media (prefers-color-scheme: dark) { :root { --ink: #f0f6fc; --soft: #9198a1; --red: #ff7b72; --blue: #79c0ff;
  --right: #3fb950; --push: #e3b341; } }
body { margin: 0; background: transparent; position: relative; }
img, svg { position: absolute; left: 0; top: 0; }
text { font: 27px "Liberation Sans", Arial, sans-serif; fill: var(--ink); font-variant-numeric: tabular-nums; }
.title { font-size: 30px; } .strong { font-weight: 700; } .middle { text-anchor: middle; } .end { text-anchor: end; }
.soft { fill: var(--soft); } .red { fill: var(--red); } .blue { fill: var(--blue); } .right { fill: var(--right); }
.push { fill: var(--push); } line.push { stroke: var(--push); stroke-width: 6; }
"""
PAGE = f'<!doctype html><meta charset="utf-8"><style>{STYLE}</style><body></body>'


def drawn(played: Played) -> Iterator[tuple[Frame, str]]:
    """Yield each frame with its content as HTML, which belongs into the body of `PAGE`."""
    (shown,) = animation_of(played.film, played.episode, "").things
    model, data = staged(picture_model(shown.bodies).replace("<worldbody>", SUN))
    _prepare(model)
    strips: dict[str, str] = {}
    with mujoco.Renderer(model, STRIP_HEIGHT * FINE, WIDTH * FINE) as renderer:
        for frame in frames_of(played):
            if (key := str(frame.poses)) not in strips:
                placed(model, data, frame.poses)
                strips[key] = _png(_matted(renderer, data))
            yield frame, _body(frame, strips[key])


def _body(frame: Frame, strip: str) -> str:
    image = f'<img src="data:image/png;base64,{strip}" width="{WIDTH}" height="{STRIP_HEIGHT}"'
    parts = [
        '<text class="title strong" x="0" y="30">How heavy is the <tspan class="blue">blue</tspan> cart?</text>',
        f'<text class="soft end" x="{WIDTH}" y="30">{frame.time:.2f} s</text>',
        *_cart(frame.poses["object_1"][0], "red", "1 kg"),
        *_cart(frame.poses["object_2"][0], "blue", frame.mass),
        *(_push(frame.poses["object_1"][0], frame.push) if frame.push else ()),
        *(part for row, line in enumerate(frame.lines) for part in _row(row, line)),
    ]
    return (
        f'{image} style="top: {STRIP_TOP}px"><svg xmlns="http://www.w3.org/2000/svg" width="{WIDTH}"'
        f' height="{HEIGHT}">{"".join(parts)}</svg>'
    )


def _x(metres: float) -> float:
    """Return the x coordinate of a position on the track in the picture [px]."""
    return WIDTH / 2 + (metres - MIDDLE_M) * WIDTH / SHOWN_M


def _cart(place: float, colour: str, mass: str) -> list[str]:
    x, y = _x(place), STRIP_TOP + 18
    return [f'<text class="middle {colour}" x="{x:.1f}" y="{y}">{colour} <tspan class="strong">{mass}</tspan></text>']


def _push(place: float, force: str) -> list[str]:
    """Draw the arrow of the force, which ends at the back of the cart."""
    tip, y = _x(place - HALF_CART_M) - 4, STRIP_TOP + STRIP_HEIGHT / 2 + 8
    return [
        f'<line class="push" x1="{tip - 72:.1f}" y1="{y}" x2="{tip - 18:.1f}" y2="{y}"/>',
        f'<path class="push" d="M{tip:.1f} {y} l-24 -14 v28 z"/>',
        f'<text class="push strong middle" x="{tip - 40:.1f}" y="{y - 20}">{force}</text>',
    ]


def _row(row: int, line: Line) -> list[str]:
    y = ROWS_TOP + row * ROW + 30
    verdict = " right" if line.done.startswith("answer") else ""
    return [
        f'<text class="soft" x="0" y="{y}">{row + 1}</text><text x="30" y="{y}">{line.done}</text>',
        f'<text class="strong end{verdict}" x="{WIDTH}" y="{y}">{_coloured(line.read)}</text>',
    ]


def _coloured(text: str) -> str:
    """Colour the words that name the carts."""
    return re.sub(r"red|blue", lambda word: f'<tspan class="{word[0]}">{word[0]}</tspan>', text)


def _prepare(model: mujoco.MjModel) -> None:
    """Set the light and the field of view. Oversampling smooths the edges, in place of the renderer."""
    model.light_active[:] = True
    model.vis.headlight.ambient[:] = 0.55
    model.vis.headlight.diffuse[:] = model.vis.headlight.specular[:] = 0
    model.vis.quality.offsamples = 0
    model.vis.global_.offwidth, model.vis.global_.offheight = WIDTH * FINE, STRIP_HEIGHT * FINE
    model.stat.center[:], model.stat.extent = (MIDDLE_M, 0.0, RAIL_M), 20.0
    model.vis.global_.fovy = float(2 * np.degrees(np.arctan(SHOWN_M / 2 / DISTANCE_M * STRIP_HEIGHT / WIDTH)))


def _matted(renderer: mujoco.Renderer, data: mujoco.MjData) -> NDArray[np.uint8]:
    """Render the model from the front without a background, as RGBA (height, width, 4).

    It is rendered on white and on black. Pixels that are equal in both renderings are opaque; pixels that have the
    colour of the background in both are transparent.
    """
    camera = mujoco.MjvCamera()
    camera.type = mujoco.mjtCamera.mjCAMERA_FREE
    camera.azimuth, camera.elevation, camera.distance = 90.0, -14.0, DISTANCE_M
    camera.lookat[:] = (MIDDLE_M, 0.0, RAIL_M)
    renderer.update_scene(data, camera)
    renderer.scene.flags[mujoco.mjtRndFlag.mjRND_SKYBOX] = 1
    on_white = renderer.render().astype(np.float64)
    renderer.scene.flags[mujoco.mjtRndFlag.mjRND_SKYBOX] = 0
    on_black = renderer.render().astype(np.float64)
    opacity = 1 - (on_white - on_black).mean(axis=2, keepdims=True) / 255
    weighted = np.concatenate([on_black, opacity * 255], axis=2)
    height, width, half = STRIP_HEIGHT * FINE, WIDTH * FINE, round(FINE / SCALE)
    small = weighted.reshape(height // half, half, width // half, half, 4).mean(axis=(1, 3))
    colours = small[:, :, :3] / np.maximum(small[:, :, 3:] / 255, 1e-6)
    return np.round(np.concatenate([colours.clip(0, 255), small[:, :, 3:]], axis=2)).astype(np.uint8)


def _png(pixels: NDArray[np.uint8]) -> str:
    file = io.BytesIO()
    Image.fromarray(pixels, "RGBA").save(file, "PNG")
    return base64.b64encode(file.getvalue()).decode("ascii")
