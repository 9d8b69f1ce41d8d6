"""Curricula of trainers: windows on steps of difficulty that follow the success rate of an agent.

A trainer names its curriculum, and each name has a window of its own. Episodes are drawn from the steps in the window.
Only rewards at its hardest step move it, so it settles where the agent succeeds sometimes.
"""

import hashlib
import itertools
import math
from collections import OrderedDict
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field
from itertools import groupby
from typing import Any

from evaluator.errors import RefusedRequest
from evaluator.referee.contract import Variant
from scenes import is_world, place_of
from scenes.splits import Split

MOST = 1000
"""Largest number of curricula that are remembered; the one that was used least recently is forgotten first."""
WIDTH = 3
"""Largest number of steps in a window."""
ENOUGH = 16
"""Number of rewards at the hardest step after which the window may move."""
RAISE, LOWER = 0.7, 0.2
"""Success rates at the hardest step from which the window moves up, and up to which it moves down."""
STEPS = 10
"""Number of steps into which scenes with difficulties are divided."""

Steps = tuple[tuple[int, ...], ...]
"""Ids of the scenes of each step, the easiest step first."""


@dataclass(slots=True)
class Window:
    """Consecutive steps of difficulty, the first one alone at the start."""

    steps: int
    """Number of all steps."""
    low: int = 0
    high: int = 0
    """Easiest and hardest step in the window."""
    tried: int = 0
    right: int = 0
    """Rewards at the hardest step since the window moved last, and how many of them were for right answers."""

    def add(self, step: int, *, right: bool) -> None:
        """Count a reward. One of another step than the hardest moves nothing."""
        if step != self.high:
            return
        self.tried += 1
        self.right += right
        if self.tried < ENOUGH:
            return
        rate = self.right / self.tried
        self.high = min(max(self.high + (rate >= RAISE) - (rate <= LOWER), 0), self.steps - 1)
        self.low = max(self.high - WIDTH + 1, 0)
        self.tried = self.right = 0


def steps_of(pool: Split, difficulties: Mapping[int, tuple[float, float]]) -> Steps:
    """Divide the scenes of a split by difficulty, or worlds by level. Scenes of unknown difficulty are left out.

    Args:
        pool: The scenes.
        difficulties: Scene → its difficulty and the standard error of it [logits].

    Raises:
        RefusedRequest: No scene has a difficulty.
    """
    if is_world(pool.scenes[0]):
        levels = groupby(sorted(pool.scenes), key=lambda scene: place_of(scene)[0])
        return tuple(tuple(scenes) for _, scenes in levels)
    known = sorted((scene for scene in pool.scenes if scene in difficulties), key=lambda scene: difficulties[scene][0])
    if not known:
        raise RefusedRequest(404, f"no scene of {pool.label} has a known difficulty; `--difficulties` names a file")
    size = math.ceil(len(known) / STEPS)
    return tuple(tuple(known[start : start + size]) for start in range(0, len(known), size))


@dataclass(slots=True)
class _Curriculum:
    pool: str
    """Name and version of the split, or `worlds`."""
    steps: Steps
    window: Window
    place: int
    """Number of the window's present place, which no place of another window or before a move has."""


@dataclass(slots=True)
class Curricula:
    """The windows of all trainers. They last as long as the process."""

    _named: OrderedDict[str, _Curriculum] = field(default_factory=OrderedDict[str, _Curriculum])
    _places: Iterator[int] = field(default_factory=itertools.count, repr=False)

    def draw(self, name: str, pool: Split, steps: Steps, random_seed: int) -> Variant:
        """Draw a variant from the window of a curriculum, which begins with its first draw.

        Args:
            name: Name of the curriculum.
            pool: Scenes and seeds.
            steps: The scenes in steps.
            random_seed: The same one draws the same variant as long as the window stays.

        Raises:
            RefusedRequest: The curriculum has other scenes.
        """
        found = self._named.setdefault(name, _Curriculum(pool.label, steps, Window(len(steps)), next(self._places)))
        self._named.move_to_end(name)
        while len(self._named) > MOST:
            self._named.popitem(last=False)
        if (found.pool, found.steps) != (pool.label, steps):
            raise RefusedRequest(
                409,
                f"the curriculum {name!r} has other scenes, of {found.pool}: name another, or DELETE /curricula/NAME",
            )
        window = found.window
        drawn = int.from_bytes(hashlib.sha256(f"{pool.label} {random_seed}".encode()).digest(), "big")
        drawn, step = divmod(drawn, window.high - window.low + 1)
        scenes = steps[window.low + step]
        drawn, place = divmod(drawn, len(scenes))
        seed = drawn % len(pool.seeds)
        index = pool.scenes.index(scenes[place]) + len(pool.scenes) * seed
        split = "" if pool.name == "worlds" else pool.label
        return Variant(scenes[place], pool.seeds[seed], split, index, (name, window.low + step, found.place))

    def add(self, variant: Variant, *, right: bool) -> None:
        """Count the reward of a variant, if its curriculum was not reset, forgotten or moved since it was drawn."""
        name, step, place = variant.step or ("", 0, 0)
        found = self._named.get(name)
        if found is None or found.place != place:
            return
        before = found.window.high
        found.window.add(step, right=right)
        if found.window.high != before:
            found.place = next(self._places)

    def state(self, name: str) -> dict[str, Any]:
        """The window of a curriculum, with the scenes of its steps.

        Raises:
            RefusedRequest: There is no such curriculum.
        """
        if name not in self._named:
            raise RefusedRequest(404, "there is no such curriculum: it begins with the first episode that names it")
        found = self._named[name]
        return {"pool": found.pool, **asdict(found.window), "steps": found.steps}

    def reset(self, name: str) -> None:
        """Forget a curriculum; one of the same name begins at the easiest step."""
        self._named.pop(name, None)
