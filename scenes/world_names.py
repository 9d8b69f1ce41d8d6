"""References to worlds: `world:LEVEL:INDEX`, and the scene ids that represent them as numbers."""

import re

from scenes.errors import WorldError

FIRST_ID, LEVEL_IDS = 10_000_000, 100_000
"""Scene id of the first world of level 0, and number of ids per level."""
_REFERENCE = re.compile(r"world:(\d{1,2})(?:-(\d{1,2}))?(?::(\d{1,5})(?:-(\d{1,5}))?)?")


def scene_id_of(level: int, index: int) -> int:
    """The scene id of a world."""
    return FIRST_ID + level * LEVEL_IDS + index


def is_world(scene_id: int) -> bool:
    """Whether a scene id represents a world."""
    return scene_id >= FIRST_ID


def place_of(scene_id: int) -> tuple[int, int]:
    """Return level and index of the world with a scene id."""
    return divmod(scene_id - FIRST_ID, LEVEL_IDS)


def reference_of(scene_id: int) -> str:
    """Display name of a scene id: `world:LEVEL:INDEX` for a world, the number for any other scene."""
    return "world:{}:{}".format(*place_of(scene_id)) if is_world(scene_id) else str(scene_id)


def parse_worlds(text: str) -> tuple[range, range | None]:
    """Parse a reference such as `world:5:17` or `world:1-8:0-9`; returns its levels and indexes, None for all indexes.

    Raises:
        WorldError: It is malformed.
    """
    found = _REFERENCE.fullmatch(text)
    if found is None:
        raise WorldError(f"{text} names no worlds; write world:LEVEL:INDEX, such as world:5:17 or world:1-8:0-9")
    low, high, first, last = (None if part is None else int(part) for part in found.groups())
    assert low is not None
    indexes = None if first is None else range(first, (first if last is None else last) + 1)
    levels = range(low, (low if high is None else high) + 1)
    if not levels or indexes == range(0):
        raise WorldError(f"{text} names no worlds: a range goes from the smaller number to the larger one")
    return levels, indexes


def one_world(text: str) -> int:
    """Return the scene id of a reference to a single world.

    Raises:
        WorldError: It is malformed, or names several.
    """
    levels, indexes = parse_worlds(text)
    if len(levels) > 1 or indexes is None or len(indexes) > 1:
        raise WorldError(f"{text} does not name one world; write one such as world:5:17")
    return scene_id_of(levels[0], indexes[0])
