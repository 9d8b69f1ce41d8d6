"""Levels of difficulty and their attributes. Each attribute can also be set separately."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, fields, replace
from typing import Any, Final

from scenes.errors import WorldError
from scenes.worlds.parts import Apparatus

GRAMMAR: Final = 2
"""Version of the grammar and of how worlds are sampled from it; records of older versions stay readable."""
LEVELS = range(1, 11)

_SINGLE = (Apparatus.PUCK, Apparatus.WHEEL, Apparatus.GLIDER)
_ALL = (*_SINGLE, Apparatus.PAIR)


@dataclass(frozen=True, slots=True)
class Difficulty:
    """The attributes that determine how difficult a world is."""

    apparatuses: tuple[Apparatus, ...]
    """The possible kinds of apparatus."""
    terms: int
    """Number of terms; at most four on a wheel or a rail."""
    modulations: int
    """Number of modulations, at most two per term."""
    hidden: int
    """Largest number of hidden bodies."""
    noise: float
    """Smallest standard deviation of a position [m, rad]; the number for velocities is twice as large [m/s, rad/s]."""
    looks: int
    """Number of readings of each state that the laboratory allows; a reading takes 0.45 s of laboratory time."""
    strong: float
    """Forces in questions, as a multiple of the largest allowed one."""
    kinds: tuple[str, ...] = ("strong", "far", "late")
    """Possible kinds of questions. A world has three questions, of different kinds if possible."""
    bound: float = 0.25
    """Smallest standard error that the readings allow for an answer, in tolerances.

    The noise is increased until the error reaches it.
    """
    bias: float = 0.0
    """Largest bias of the position instrument [m, rad]; 0 for none. See `scenes.worlds.instrument_errors`."""
    drift: float = 0.0
    """Largest drift of the position instrument [m/s, rad/s]; 0 for none."""

    def changed(self, **attributes: Any) -> "Difficulty":
        """Return a copy of the difficulty with some attributes changed.

        Raises:
            WorldError: There is no such attribute, or its value is out of range.
        """
        known = {field.name for field in fields(self)}
        if unknown := sorted(set(attributes) - known):
            raise WorldError(f"a world has no attribute {unknown[0]!r}; there are {', '.join(sorted(known))}")
        found = replace(self, **attributes)
        for name, (low, high) in _BOUNDS.items():
            if not low <= getattr(found, name) <= high:
                raise WorldError(f"{name} must be from {low:g} to {high:g}, not {getattr(found, name):g}")
        if not found.kinds or not set(found.kinds) <= set(KINDS):
            raise WorldError(f"kinds must be some of {', '.join(KINDS)}")
        if not found.apparatuses:
            raise WorldError("apparatuses must be some of puck, pair, wheel, glider")
        for apparatus in found.apparatuses:
            if not set(kinds_for(apparatus, found.kinds)) - {"which"}:
                raise WorldError(f"kinds must be more: those would leave a {apparatus} without a number to predict")
        return found

    def changed_by(self, settings: Iterable[str]) -> "Difficulty":
        """Parse attributes such as `terms=4`, `noise=0.01`, `kinds=strong,late`, and return the changed difficulty.

        Raises:
            WorldError: As for `changed`, or a value cannot be parsed.
        """
        attributes: dict[str, Any] = {}
        for setting in settings:
            name, _, value = setting.partition("=")
            read = _READ.get(name, float)
            try:
                attributes[name] = read(value)
            except ValueError as error:
                raise WorldError(f"{setting}: write NAME=VALUE, such as terms=4 or kinds=strong,late") from error
        return self.changed(**attributes)


_PLAIN = ("strong", "far", "late")
KINDS = (*_PLAIN, "apart", "push", "which")
"""Kinds of questions, described at `scenes.worlds.questions.Question`."""


def kinds_for(apparatus: Apparatus, kinds: Iterable[str]) -> list[str]:
    """Return the kinds of questions that an apparatus supports. A wheel has no `far`, and `apart` needs two pucks."""
    none = {"far"} if apparatus is Apparatus.WHEEL else set[str]()
    return [kind for kind in kinds if kind not in none and (kind != "apart" or apparatus is Apparatus.PAIR)]


_READ: Mapping[str, Callable[[str], Any]] = {
    **dict.fromkeys(("terms", "modulations", "hidden", "looks"), int),
    "kinds": lambda text: tuple(text.split(",")),
    "apparatuses": lambda text: tuple(map(Apparatus, text.split(","))),
}
"""Parsers of attribute values; all other attributes are floats."""
_BOUNDS = {"terms": (1, 6), "modulations": (0, 6), "hidden": (0, 3), "noise": (1e-4, 0.1), "looks": (12, 200),
           "strong": (1.1, 5.0), "bound": (0.0, 0.35), "bias": (0.0, 2.0), "drift": (0.0, 0.2)}  # fmt: skip

_TABLE = {
    1: Difficulty(_SINGLE, 1, 0, 0, 0.002, 30, 1.8),
    2: Difficulty(_SINGLE, 2, 0, 0, 0.002, 34, 1.8),
    3: Difficulty(_SINGLE, 2, 1, 0, 0.002, 40, 1.9, (*_PLAIN, "push")),
    4: Difficulty(_ALL, 3, 1, 0, 0.003, 46, 2.0, (*_PLAIN, "apart", "push")),
    5: Difficulty(_ALL, 3, 2, 1, 0.003, 52, 2.0, KINDS),
    6: Difficulty(_ALL, 4, 2, 1, 0.003, 58, 2.2, KINDS),
    7: Difficulty((Apparatus.PUCK, Apparatus.PAIR), 4, 3, 1, 0.004, 66, 2.2, KINDS),
    8: Difficulty((Apparatus.PUCK, Apparatus.PAIR), 5, 3, 1, 0.004, 74, 2.4, KINDS),
    9: Difficulty((Apparatus.PUCK, Apparatus.PAIR), 5, 4, 2, 0.004, 82, 2.4, KINDS),
    10: Difficulty((Apparatus.PUCK, Apparatus.PAIR), 6, 5, 2, 0.005, 90, 2.6, KINDS),
}


def difficulty_of(level: int) -> Difficulty:
    """The attributes of a level.

    Raises:
        WorldError: There is no such level.
    """
    if level not in _TABLE:
        raise WorldError(f"there is no level {level}; levels are 1 to {LEVELS[-1]}")
    return _TABLE[level]
