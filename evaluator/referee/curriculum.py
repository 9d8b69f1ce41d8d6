"""Curricula for trainers: the difficulty of the episodes follows the success rate of the agent.

Scenes are sorted into steps of difficulty. Each curriculum, identified by a name that the trainer chooses, has a window
of consecutive steps, from which its variants are drawn. Only rewards at the hardest step of the window move it, so it
settles where the agent succeeds in some episodes.
"""

import hashlib
import itertools
import math
import threading
from collections import OrderedDict
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

from evaluator.errors import RefusedRequest
from evaluator.referee.contract import Variant
from scenes import is_world, place_of
from scenes.splits import Split

MOST = 1000
"""Largest number of curricula in memory; the least recently used one is evicted."""
WIDTH = 3
"""Largest number of steps in a window."""
ENOUGH = 16
"""Number of rewards at the hardest step after which the window may move."""
RAISE, LOWER = 0.7, 0.2
"""Limits of the success rate at the hardest step.

The window moves up if the rate is at least the first, and down if it is at most the second.
"""
STEPS = 10
"""Number of steps into which scenes with difficulties are divided."""

Steps = tuple[tuple[int, ...], ...]
"""Ids of the scenes of each step, the easiest step first."""


@dataclass(slots=True)
class Window:
    """A window of consecutive steps of difficulty. At the start it holds only the easiest step."""

    steps: int
    """Number of steps of the whole curriculum."""
    low: int = 0
    high: int = 0
    """Indices of the easiest and the hardest step in the window."""
    tried: int = 0
    right: int = 0
    """Number of rewards at the hardest step since the window last moved, and number of right answers among them."""

    def add(self, step: int, *, right: bool) -> None:
        """Count a reward. Only rewards at the hardest step can move the window."""
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
    """Sort the scenes of a split by difficulty, or worlds by level, into steps.

    Scenes of unknown difficulty are omitted.

    Args:
        pool: The scenes.
        difficulties: Scene → difficulty and its standard error [logits].

    Raises:
        RefusedRequest: No scene has a difficulty.
    """
    if is_world(pool.scenes[0]):
        levels = itertools.groupby(sorted(pool.scenes), key=lambda scene: place_of(scene)[0])
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
    """Unique number of the window's present position. It changes with each move and differs between curricula."""


@dataclass(slots=True)
class Curricula:
    """The curricula of all trainers, kept in memory until the process ends.

    `draw` runs in worker threads and the other methods on the event loop, so each method acquires the lock.
    """

    _named: OrderedDict[str, _Curriculum] = field(default_factory=OrderedDict[str, _Curriculum])
    _places: Iterator[int] = field(default_factory=itertools.count, repr=False)
    _lock: threading.Lock = field(default_factory=threading.Lock, repr=False)

    def draw(self, name: str, pool: Split, steps: Steps, random_seed: int) -> Variant:
        """Draw a variant from the window of a curriculum. The first draw creates the curriculum.

        Args:
            name: Name of the curriculum.
            pool: Scenes and seeds.
            steps: The scenes, grouped into steps of difficulty.
            random_seed: Determines the variant as long as the window does not move.

        Raises:
            RefusedRequest: The curriculum exists with other scenes.
        """
        with self._lock:
            found = self._found(name, pool, steps)
            low, high, at = found.window.low, found.window.high, found.place
        drawn = int.from_bytes(hashlib.sha256(f"{pool.label} {random_seed}".encode()).digest(), "big")
        drawn, step = divmod(drawn, high - low + 1)
        scenes = steps[low + step]
        drawn, place = divmod(drawn, len(scenes))
        seed = drawn % len(pool.seeds)
        index = pool.scenes.index(scenes[place]) + len(pool.scenes) * seed
        split = "" if pool.name == "worlds" else pool.label
        return Variant(scenes[place], pool.seeds[seed], split, index, (name, low + step, at))

    def _found(self, name: str, pool: Split, steps: Steps) -> _Curriculum:
        """Return a curriculum and mark it as used; creates it if there is none. The caller holds the lock.

        Raises:
            RefusedRequest: The curriculum exists with other scenes.
        """
        found = self._named.get(name)
        if found is None:
            # The steps of a large folder of worlds take megabytes, so curricula with equal steps share one tuple.
            shared = next((one.steps for one in reversed(self._named.values()) if one.steps == steps), steps)
            found = _Curriculum(pool.label, shared, Window(len(steps)), next(self._places))
            self._named[name] = found
        self._named.move_to_end(name)
        while len(self._named) > MOST:
            self._named.popitem(last=False)
        if (found.pool, found.steps) != (pool.label, steps):
            raise RefusedRequest(
                409,
                f"the curriculum {name!r} has other scenes, of {found.pool}: name another, or DELETE /curricula/NAME",
            )
        return found

    def add(self, variant: Variant, *, right: bool) -> None:
        """Count a variant's reward, unless its curriculum was reset, evicted or moved after the draw."""
        name, step, place = variant.step or ("", 0, 0)
        with self._lock:
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
        with self._lock:
            found = self._named.get(name)
            if found is None:
                raise RefusedRequest(404, "there is no such curriculum: it begins with the first episode that names it")
            return {"pool": found.pool, **asdict(found.window), "steps": found.steps}

    def reset(self, name: str) -> None:
        """Delete a curriculum. A later curriculum of the same name starts at the easiest step."""
        with self._lock:
            self._named.pop(name, None)
