"""Builds one MJCF model with the slider at the start and at the end of each measurement, like a multiple exposure.

The model contains only what the server may show of the scene at those moments. This module does not render it.
"""

import xml.etree.ElementTree as ET
from collections.abc import Sequence
from typing import NamedTuple

from evaluator.records.episode import Episode
from physment_mcp.scene import load_scene, load_variants
from physment_mcp.session import Session
from physment_mcp.tools.calls import call
from physment_mcp.visibility import bodies_of, visibility_of
from physment_mcp.world.pictures.showing import picture_model
from tests.harness.front_page.episode import PACKS

SLIDER = "object_1"
GHOST = "0.80 0.30 0.20 0.30"
"""Colour of the slider where it was set down; the last number is the opacity."""


class Moments(NamedTuple):
    """The visible bodies at two moments of an iteration, as MJCF."""

    before: str
    """The slider has been set down."""
    after: str
    """Its momentum has been read."""


def exposure(episode: Episode) -> str:
    """Return one model with the ramps, and a copy of the slider for each moment."""
    moments = _moments(episode)
    root = ET.fromstring(moments[0].before)
    world = root.find("worldbody")
    assert world is not None
    world.remove(_slider(world))
    for number, moment in enumerate(moments, start=1):
        world.append(_named(_slider(ET.fromstring(moment.before)), f"before_{number}", GHOST))
        world.append(_named(_slider(ET.fromstring(moment.after)), f"after_{number}"))
    return ET.tostring(root, encoding="unicode")


def _moments(episode: Episode) -> Sequence[Moments]:
    """Replay the calls of the episode, and copy the visible world after the first and the last call of each turn."""
    scene = load_scene(episode.key.scene, episode.key.seed, PACKS)
    session = Session(scene)
    visibility = visibility_of(scene, load_variants(episode.key.scene, PACKS))
    found: list[Moments] = []
    for turn in episode.turns[:-1]:
        models: list[str] = []
        for exchange in turn.exchanges:
            call(session, exchange.call.tool, dict(exchange.call.arguments))
            # The bench is a fixture; it is left out.
            models.append(picture_model(body for body in bodies_of(session, visibility.now(session)) if body.pose))
        found.append(Moments(models[0], models[-1]))
    return found


def _slider(tree: ET.Element) -> ET.Element:
    return next(body for body in tree.iter("body") if body.get("name") == SLIDER)


def _named(body: ET.Element, name: str, colour: str = "") -> ET.Element:
    body.set("name", name)
    geom = body.find("geom")
    assert geom is not None
    if colour:
        geom.set("rgba", colour)
    return body
