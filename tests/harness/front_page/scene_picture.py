"""Draws the scene of the README: all four measurements in one picture, and below each ramp its reading.

Set MUJOCO_GL before importing this module.
"""

# MuJoCo ships no type stubs.
# pyright: reportAttributeAccessIssue=false, reportUnknownArgumentType=false, reportUnknownMemberType=false
# pyright: reportUnknownVariableType=false

import base64
import io

import mujoco
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from evaluator.records.episode import Episode, GradeRecord
from physment_mcp.world.pictures.drawing import staged
from tests.harness.front_page.episode import RAMPS, Measurement, measurements, reading, title
from tests.harness.front_page.exposure import exposure

WIDTH, STRIP_TOP, STRIP_HEIGHT, ROWS_TOP, ROW = 800, 40, 84, 160, 34
"""Layout of the picture [px]; the strip shows the row of ramps."""
STRIP_LEFT, STRIP_WIDTH = 106, 694
SHOWN_M = 12.4
"""Width of the part of the world that the strip shows [m]; the ramps stand 1 m apart."""
TEXT_WIDTH = 150
"""Width reserved for a reading and its meaning [px]."""
NOTE = (
    "Each iteration: set the slider down (pale), wait 1 s, read its momentum along x, for a mass of 1 kg.",
    "Band: the ramps that can still be the answer. Dot: the ramp that is tried.",
)
NOTE_LINE = 19
FINE = 3
"""Oversampling factor of the strip; a further factor of two smooths the edges."""

STYLE = """
:root { --ink: #1f2328; --soft: #59636e; --line: #d1d9e0; --band: #818b981f; --slides: #bc4c00; --holds: #0969da;
  --right: #1a7f37; }
@media (prefers-color-scheme: dark) { :root { --ink: #f0f6fc; --soft: #9198a1; --line: #3d444d; --band: #656c7640;
  --slides: #f0883e; --holds: #58a6ff; --right: #3fb950; } }
body { margin: 0; background: transparent; }
text { font: 14px "Liberation Sans", Arial, sans-serif; fill: var(--ink); font-variant-numeric: tabular-nums; }
.strong { font-weight: 700; } .title { font-size: 16px; font-weight: 700; } .soft { fill: var(--soft); }
.small { font-size: 12.5px; } .middle { text-anchor: middle; } .end { text-anchor: end; }
.band { fill: var(--band); } .right { fill: var(--right); }
.slides { fill: var(--slides); } .holds { fill: var(--holds); }
.on { fill: #fff; }
@media (prefers-color-scheme: dark) { .on { fill: #0d1117; } }
line { stroke: var(--line); }
"""


def page_of(episode: Episode, grade: GradeRecord) -> str:
    """Return the picture as an HTML page that follows the reader's colour scheme; its SVG has the picture's size."""
    tried = measurements(episode)
    strip = base64.b64encode(_png(_matted(exposure(episode)))).decode("ascii")
    height = ROWS_TOP + ROW * (len(tried) + 1) + 12 + NOTE_LINE * len(NOTE)
    parts = [
        '<text class="title" x="0" y="18">Which is the shallowest ramp on which the slider begins to slide?</text>',
        f'<text class="soft end" x="{WIDTH}" y="18">{title(episode)}</text>',
        f'<image x="{STRIP_LEFT}" y="{STRIP_TOP}" width="{STRIP_WIDTH}" height="{STRIP_HEIGHT}"'
        f' href="data:image/png;base64,{strip}"/>',
        *_scale(),
        *(part for row, measured in enumerate(tried) for part in _row(row, measured)),
        *_answer(len(tried), int(str(episode.answer)), grade.grade.strict.value),
        *(
            f'<text class="soft small" x="0" y="{height - 6 - NOTE_LINE * above}">{line}</text>'
            for above, line in enumerate(reversed(NOTE))
        ),
    ]
    body = "\n".join(parts)
    return (
        f'<!doctype html><meta charset="utf-8"><style>{STYLE}</style>'
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{WIDTH}" height="{height}" style="display:block">{body}</svg>'
    )


def _x(ramp: float) -> float:
    """Return the x coordinate of a ramp in the picture [px]."""
    return STRIP_LEFT + STRIP_WIDTH / 2 + (ramp - (RAMPS + 1) / 2) * STRIP_WIDTH / SHOWN_M


def _scale() -> list[str]:
    y = STRIP_TOP + STRIP_HEIGHT + 18
    ramps = (
        f'<text class="middle small" x="{_x(ramp):.1f}" y="{y}"><tspan class="strong">{ramp}</tspan>'
        f'<tspan class="soft" dx="4">{9 + 3 * ramp}°</tspan></text>'
        for ramp in range(1, RAMPS + 1)
    )
    return [f'<text class="soft" x="0" y="{y}">ramp, tilt</text>', *ramps]


def _row(row: int, measured: Measurement) -> list[str]:
    top, kind = ROWS_TOP + row * ROW, "slides" if measured.slides else "holds"
    half, middle = STRIP_WIDTH / SHOWN_M / 2, top + ROW / 2
    left, right = _x(measured.low) - half + 2, _x(measured.high) + half - 2
    dot = _x(measured.ramp)
    # A text that would cross the end of its band goes behind it.
    text = dot + 15 if dot + 15 + TEXT_WIDTH < right else right + 10
    return [
        f'<text class="soft" x="0" y="{middle + 5}">iteration {row + 1}</text>',
        f'<rect class="band" x="{left:.1f}" y="{top + 3}" width="{right - left:.1f}" height="{ROW - 6}" rx="6"/>',
        f'<circle class="{kind}" cx="{dot:.1f}" cy="{middle}" r="7"/>',
        f'<text x="{text:.1f}" y="{middle + 5}">{reading(measured.momentum)} kg·m/s: '
        f'<tspan class="strong {kind}">{kind}</tspan></text>',
    ]


def _answer(row: int, ramp: int, verdict: str) -> list[str]:
    middle = ROWS_TOP + row * ROW + ROW / 2
    return [
        f'<text class="soft" x="0" y="{middle + 5}">answer</text>',
        f'<rect class="right" x="{_x(ramp) - 13:.1f}" y="{middle - 12}" width="26" height="24" rx="6"/>',
        f'<text class="strong middle on" x="{_x(ramp):.1f}" y="{middle + 5}">{ramp}</text>',
        f'<text class="strong right" x="{_x(ramp) + 22:.1f}" y="{middle + 5}">{verdict}</text>',
    ]


def _matted(mjcf: str) -> NDArray[np.uint8]:
    """Render the model from the front without a background, as RGBA (height, width, 4).

    It is rendered on white and on black. Pixels that are equal in both renderings are opaque; pixels that have the
    colour of the background in both are transparent.
    """
    model, data = staged(mjcf)
    height, width = STRIP_HEIGHT * FINE * 2, STRIP_WIDTH * FINE * 2
    model.vis.global_.offwidth, model.vis.global_.offheight = width, height
    camera = mujoco.MjvCamera()
    camera.type = mujoco.mjtCamera.mjCAMERA_FREE
    # The camera looks from +x, towards which the ramps slope, and is far away, so that all ramps appear equally large.
    camera.azimuth, camera.elevation, camera.distance = 180.0, -22.0, 24.0
    camera.lookat[:] = model.stat.center[:] = (0.0, (RAMPS + 1) / 2, 1.0)
    model.stat.extent = 20.0
    model.vis.global_.fovy = float(2 * np.degrees(np.arctan(SHOWN_M / 2 / camera.distance * height / width)))
    with mujoco.Renderer(model, height, width) as renderer:
        renderer.update_scene(data, camera)
        on_white = renderer.render().astype(np.float64)
        renderer.scene.flags[mujoco.mjtRndFlag.mjRND_SKYBOX] = 0
        on_black = renderer.render().astype(np.float64)
    opacity = 1 - (on_white - on_black).mean(axis=2, keepdims=True) / 255
    weighted = np.concatenate([on_black, opacity * 255], axis=2)
    small = weighted.reshape(height // 2, 2, width // 2, 2, 4).mean(axis=(1, 3))
    colours = small[:, :, :3] / np.maximum(small[:, :, 3:] / 255, 1e-6)
    return np.round(np.concatenate([colours.clip(0, 255), small[:, :, 3:]], axis=2)).astype(np.uint8)


def _png(pixels: NDArray[np.uint8]) -> bytes:
    file = io.BytesIO()
    Image.fromarray(pixels, "RGBA").save(file, "PNG")
    return file.getvalue()
