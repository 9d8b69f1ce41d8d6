"""Generates random tool calls: most fit their schemas, the others violate them in every way that JSON allows.

Uses the published schemas, and the ids and limits of a session. Does not check results.
"""

import functools
import math
import random
from collections.abc import Callable, Collection, Mapping
from copy import deepcopy
from dataclasses import dataclass
from typing import Any

from physment_mcp.session import Session
from physment_mcp.tools import TOOLS
from scenes.protocol import Call

MOODS: tuple[dict[str, float], ...] = (
    {"step": 4, "create_objects": 2, "attach_objects": 1.5, "detect_collision": 1.5, "apply_force": 1.5},
    {"step": 2, "create_objects": 25, "attach_objects": 10, "delete_objects": 4, "change_position": 3},
    {"step": 9, "set_velocity": 5, "apply_force": 5, "apply_torque": 5, "move_object": 4, "detect_collision": 4},
)
"""Relative frequencies of tools in an episode: mixed, mostly building, mostly moving. Other tools have `_WEIGHT`."""
_WEIGHT = {"find_objects": 0.2, "delete_objects": 0.5, "answer": 0.15}
"""Relative frequencies of tools that a mood does not list; all others have 1."""
_DISABLED_WEIGHT = 0.1
_MISCHIEF = 0.3
"""Share of calls that are made invalid."""
_FEW, _CROWD = 3, 10
"""Numbers of created objects above which steps are short, and very short, because steps with many objects are slow."""
_NO_TOOLS = ("", "Step", "step ", "get_position\x00", "__class__", "reset", "𝚜𝚝𝚎𝚙", "s" * 65, "create-objects")
_TEXTS = (
    "", " ", "object_1", "object_01", "OBJECT_1", "object_1 ", "object_1\x00", "1", "01", "-1", "1.0", "٣", "object_٣",
    "world", "laboratory", "created:ball1", "object_99", "NaN", "inf", "None", "true", "\ud800", "\u202eevil",
    "é\u0301", "<b>&amp;</b>", "'; DROP TABLE", "{object_1}", "%s%n", "\n\n", "a" * 64, "a" * 65, "\U000e0001" * 64,
    "𝟙" * 64, "ß" * 9_000, "x" * 30_000,
)  # fmt: skip
_NUMBERS = (
    0, -0.0, 1, -1, 5e-324, -5e-324, 1e-308, 1e-12, 1e6, -1e6, 1_000_000.0001, 1e7, 1e16, 1e308, -1e308,
    2**53 + 1, 2**63, -(2**64), 10**300, 10**400, math.nan, math.inf, -math.inf,
)  # fmt: skip
_OTHERS = (
    True, False, None, [], {}, [1], [1, 2], [1, 2, 3], [1, 2, 3, 4], [[1, 2, 3]], {"x": 1}, {"": {}}, ["1", 2, 3],
)  # fmt: skip
_PLAIN = {"boolean": (False, True), "null": (None,), "integer": (-5, 0, 1, 7), "string": _TEXTS[:-2]}
"""Values of types without bounds."""


@functools.cache
def schemas() -> dict[str, dict[str, Any]]:
    """The input schemas, by tool."""
    return {tool.name: tool.input_schema() for tool in TOOLS}


def draw_call(session: Session, deleted: Collection[str], mood: Mapping[str, float], source: random.Random) -> Call:
    """Generate the next call of an episode.

    Args:
        session: The episode, for its ids and limits.
        deleted: Ids of deleted objects.
        mood: One of `MOODS`.
        source: Random number generator.
    """
    name = _tool(session, mood, source)
    call = fitting_call(session, name, source)
    if source.random() >= _MISCHIEF:
        return call
    drawing, arguments = _Drawing(session, tuple(deleted), source), call.arguments
    for _ in range(1 + (source.random() < 0.2)):
        drawing.spoil(arguments)
    return Call(source.choice(_NO_TOOLS) if source.random() < 0.03 else name, arguments)


def fitting_call(session: Session, tool: str, source: random.Random) -> Call:
    """Generate a call whose arguments fit the tool's schema and the limits of the laboratory."""
    drawing = _Drawing(session, (), source)
    arguments = drawing.arguments(schemas()[tool])
    drawing.suit(tool, arguments)
    return Call(tool, arguments)


def _tool(session: Session, mood: Mapping[str, float], source: random.Random) -> str:
    disabled = session.scene.public.disabled_tools
    weights = [_DISABLED_WEIGHT if name in disabled else mood.get(name, _WEIGHT.get(name, 1.0)) for name in schemas()]
    return source.choices(list(schemas()), weights)[0]


@dataclass(frozen=True, slots=True)
class _Drawing:
    """The arguments of one call."""

    session: Session
    deleted: tuple[str, ...]
    """Ids of deleted objects."""
    source: random.Random

    def arguments(self, schema: Any) -> dict[str, Any]:
        """Arguments that fit a schema; half of the time, an optional one is left out."""
        required = schema.get("required", ())
        return {
            name: self.value(name, field)
            for name, field in schema.get("properties", {}).items()
            if name in required or self.source.random() < 0.5
        }

    def value(self, name: str, schema: Any) -> Any:
        """A value that fits a schema."""
        if name.endswith("_id"):
            return self._id()
        if name == "name":
            return self._name()
        if "enum" in schema:
            return self.source.choice(schema["enum"])
        if "anyOf" in schema:
            return self.value(name, self.source.choice(schema["anyOf"]))
        if schema.get("type") in _PLAIN:
            return self.source.choice(_PLAIN[schema["type"]])
        return self._several(schema) if schema.get("type") in {"array", "object"} else self._number(schema)

    def _several(self, schema: Any) -> Any:
        """A list or an object that fits a schema."""
        if schema["type"] == "object":
            inner = schema["additionalProperties"]
            return {f"part {number}": self.value("", inner) for number in range(self.source.randint(0, 3))}
        low = schema.get("minItems", 0)
        count = low if low == schema.get("maxItems") else self.source.randint(low, low + 3)
        return [self.value("", schema["items"]) for _ in range(count)]

    def _id(self) -> Any:
        known = [item.object_id for item in self.session.known()]
        if known and self.source.random() < 0.9:
            chosen = self.source.choice(known)
            number = chosen.removeprefix("object_")
            if number == chosen or self.source.random() < 0.7:
                return chosen
            return self.source.choice((number, int(number)))
        hidden = [item.object_id for item in self.session.state.objects.values() if not item.known]
        return self.source.choice([*hidden, *hidden, *self.deleted, *_TEXTS, 0, -1, 7, 10**50])

    def _name(self) -> str:
        taken = [item.object_id for item in self.session.state.objects.values()]
        if self.source.random() < 0.1:
            return self.source.choice([*taken, *_TEXTS])
        length = self.source.choice((0, 0, 0, 0, 0, 30))
        return f"ball{self.source.randrange(1000)}{'-_'[self.source.randrange(2)] * length}"

    def _number(self, schema: Any) -> float:
        """Generate a number within the bounds: a usual value, a value of any magnitude, or a bound."""
        low = schema.get("minimum", schema.get("exclusiveMinimum", -1e6))
        high = schema.get("maximum", 1e6)
        kind = self.source.random()
        if kind < 0.6:
            value = round(self.source.uniform(max(low, -5.0), min(high, 5.0)), 3)
        elif kind < 0.85:
            value = round(self.source.choice((-1, 1)) * 10 ** self.source.uniform(-3, 3), 3)
        elif kind < 0.95:
            value = self.source.choice((0.0, -0.0, 1, -1, 5e-324, 1e-308, 1e-9, 0.1 + 0.2))
        else:
            value = self.source.choice((low, high))
        value = min(max(value, low), high)
        return value if value != schema.get("exclusiveMinimum") else self.source.choice((5e-324, 1e-3, 1.0, high))

    def suit(self, name: str, arguments: dict[str, Any]) -> None:
        """Adjust a valid call so that the laboratory is likely to accept it and it runs quickly."""
        limits = self.session.limits
        match name:
            case "step":
                arguments["duration"] = self._duration()
            case "apply_force" | "apply_torque":
                limit = limits.force if name == "apply_force" else limits.torque
                if limit is not None and self.source.random() < 0.8:
                    (argument,) = arguments.keys() - {"object_id"}
                    arguments[argument] = self._load(limit)
            case "create_objects":
                if self.source.random() < 0.8:
                    arguments["radius"] = self.source.choice((0.001, 0.02, 0.05, 0.1, 0.1))
                if limits.created_mass is not None and self.source.random() < 0.7:
                    arguments["density"] = round(limits.created_mass * self.source.choice((0.1, 1, 10, 240)), 3)
            case "attach_objects":
                # Most independently drawn pairs of joint and axis are invalid.
                if arguments.get("joint", "weld") != "hinge":
                    arguments.pop("axis", None)
                else:
                    arguments["axis"] = self.source.choice(([0, 1, 0], [0, 0, 1e-300], [1e6, -1e6, 3], [0, 0, 0]))
            case _:
                pass

    def _duration(self) -> float:
        kind = self.source.random()
        created = self.session.state.created_count
        if kind < 0.75 or created > _FEW:
            return round(self.source.uniform(0.001, 0.02 if created > _CROWD else 0.1), 4)
        if kind < 0.97:
            return round(self.source.uniform(0.1, 2), 3)
        return self.source.choice((5e-324, 1e-9, 10.0, 60, 60.000001, 1e6, math.nan))

    def _load(self, limit: float) -> list[float]:
        """A vector whose size is below, at or just beyond a limit."""
        share = self.source.choice((0.0, 0.1, 0.5, 0.9, 1.0, 1 + 1e-9, 1 + 1e-6, 1.5))
        vector = [0.0, 0.0, 0.0]
        vector[self.source.randrange(3)] = self.source.choice((-1, 1)) * share * limit
        return vector

    def spoil(self, arguments: dict[str, Any]) -> None:
        """Make an argument invalid, remove an argument, or add unknown arguments."""
        ways: list[Callable[[dict[str, Any]], None]] = [self._replace] * 5 + [self._drop, self._add, self._spoil_part]
        self.source.choice(ways)(arguments)

    def _replace(self, arguments: dict[str, Any]) -> None:
        if arguments:
            arguments[self.source.choice(list(arguments))] = self._wrong()

    def _drop(self, arguments: dict[str, Any]) -> None:
        if arguments:
            del arguments[self.source.choice(list(arguments))]

    def _add(self, arguments: dict[str, Any]) -> None:
        count = self.source.choice((1, 1, 1, 3, 40))
        for number in range(count):
            name = self.source.choice(("object_id", "mass", "self", "session", "model_config", "", "é\n", "k" * 300))
            arguments[name if count == 1 else f"{name}{number}"] = self._wrong()

    def _spoil_part(self, arguments: dict[str, Any]) -> None:
        lists = [value for value in arguments.values() if isinstance(value, list) and value]
        if lists:
            part = self.source.choice(lists)
            part[self.source.randrange(len(part))] = self._wrong()
        else:
            self._replace(arguments)

    def _wrong(self) -> Any:
        kind = self.source.random()
        if kind < 0.4:
            return self.source.choice(_NUMBERS)
        if kind < 0.7:
            return self.source.choice(_TEXTS)
        if kind < 0.92:
            return deepcopy(self.source.choice(_OTHERS))  # because `_spoil_part` may change it in place
        return self.source.choice(
            (_nested(15), _nested(17), _nested(200), [0.0] * 5000, {str(n): n for n in range(50)})
        )


def _nested(levels: int) -> Any:
    value: Any = 1
    for _ in range(levels):
        value = [value]
    return value
