"""Laws as agents state them with an answer: the acceleration of each object, in the language of laws.

    {"acceleration": {"object_1": {"x": "object_1_push_x/m - c*object_1_vx", "y": "object_1_push_y/m"}},
     "let": {"m": 1.2, "c": "0.4*exp(-way/3)"},
     "state": {"way": {"start": 0, "rate": "hypot(object_1_vx, object_1_vy)"}}}

The laboratory and the graders read a law with this module. The checks depend only on the text and on the names of the
visible objects, so neither a refusal nor its duration reveals anything about the law of the laboratory.
"""

import math
import random
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, cast

from physment_mcp.contract.expressions import ExpressionError
from physment_mcp.contract.formulas import WRITTEN_BY_AGENTS, Formulas

PLACES, SPEEDS = ("x", "y", "z", "angle"), ("vx", "vy", "vz", "spin")
"""Coordinates of an object [m, rad], each of which may have an acceleration, and their rates [m/s, rad/s]."""
LOADS = ("push_x", "push_y", "push_z", "turn_x", "turn_y", "turn_z")
"""Components of the force [N] and the torque [N·m] that the agent applies to an object."""

MAX_CHARS = 4000
"""Largest number of characters of all expressions of a law together."""
MAX_LENGTH = 1000
"""Largest number of names, numbers, operators and functions of a law. Grading evaluates a law about 50,000 times, and
150,000 times if it has states. The laws of the suite have 50 to 125."""
MAX_LET, MAX_STATES = 40, 16
"""Largest numbers of auxiliary quantities and of states."""
_PROBES = 12
_SHOWN = 6
"""Largest number of values that a refusal quotes."""
_RANGES = {"t": (0.0, 60.0), "angle": (-6.0, 6.0), "spin": (-6.0, 6.0)} | dict.fromkeys(LOADS, (-9.0, 9.0))
_USUAL = (-4.0, 4.0)
"""Range from which positions [m, rad] and velocities [m/s, rad/s] of the test states are taken."""

_EXPRESSION = {"anyOf": [{"type": "string", "maxLength": 1000}, {"type": "number"}]}
SCHEMA: Mapping[str, Any] = {
    "type": "object",
    "additionalProperties": False,
    "required": ["acceleration"],
    "properties": {
        "acceleration": {
            "type": "object",
            "minProperties": 1,
            "additionalProperties": {
                "type": "object",
                "additionalProperties": False,
                "properties": dict.fromkeys(PLACES, _EXPRESSION),
            },
        },
        "let": {"type": "object", "maxProperties": MAX_LET, "additionalProperties": _EXPRESSION},
        "state": {
            "type": "object",
            "maxProperties": MAX_STATES,
            "additionalProperties": {
                "type": "object",
                "additionalProperties": False,
                "required": ["start", "rate"],
                "properties": {"start": {"type": "number"}, "rate": _EXPRESSION},
            },
        },
    },
}
"""JSON Schema of a law."""


class StatedLaw:
    """A law that has been read and checked.

    Args:
        written: The law as the agent wrote it.
        objects: Ids of the objects of which the agent knows.

    Raises:
        ExpressionError: The law is malformed, contains an unknown name or something that is not allowed, is too long,
            or has no finite value at one of the test states. The message is one sentence.
    """

    def __init__(self, written: object, objects: Sequence[str]) -> None:
        fields = _mapping("law", written, ("acceleration", "let", "state"))
        results, states = dict[str, str](), dict[str, float]()
        self.components: list[tuple[str, str]] = []
        """Object and coordinate of each stated acceleration, in the order of `rates`."""
        for name, axes in _mapping("acceleration", fields.get("acceleration")).items():
            if name not in objects:
                raise ExpressionError(f"acceleration: there is no object {name[:40]!r}; name {', '.join(objects)}")
            for axis, text in _mapping(f"acceleration.{name}", axes, PLACES).items():
                self.components.append((name, axis))
                results[f"acceleration.{name}.{axis}"] = _text(f"acceleration.{name}.{axis}", text)
        if not results:
            raise ExpressionError('acceleration: state one at least, such as {"object_1": {"x": "-object_1_vx"}}')
        let = {
            name: _text(f"let.{_shown(name)}", text) for name, text in _mapping("let", fields.get("let", {})).items()
        }
        for name, state in _mapping("state", fields.get("state", {})).items():
            parts = _mapping(f"state.{_shown(name)}", state, ("start", "rate"))
            states[name] = _start(_shown(name), parts.get("start"))
            results[f"state.{name}.rate"] = _text(f"state.{_shown(name)}.rate", parts.get("rate"))
        if len(let) > MAX_LET or len(states) > MAX_STATES:
            raise ExpressionError(f"let has at most {MAX_LET} names, and state at most {MAX_STATES}")
        size = sum(map(len, (*let, *let.values(), *states, *results.values())))
        if size > MAX_CHARS:
            raise ExpressionError(f"it has {size} characters; at most {MAX_CHARS} are allowed in all")
        self.states: Mapping[str, float] = states
        """States by name, with their values at the start of the episode, in the order of `rates`."""
        self.arguments = ["t", *variables(objects), *states]
        """Names of the arguments of `rates`."""
        given = self.arguments[: -len(states) or None]
        self._formulas = Formulas(given, {}, let, results, states, WRITTEN_BY_AGENTS)
        self.length = self._formulas.length
        """Length of the description: the number of names, numbers, operators and functions."""
        if self.length > MAX_LENGTH:
            counted = "names, numbers, operators and functions"
            raise ExpressionError(f"it has {self.length} {counted}; at most {MAX_LENGTH} are allowed in all")
        self.used = frozenset(self._formulas.used)
        """The arguments that occur in the law."""
        self.rates = self._formulas.function(self.arguments)
        """Compiled function of the arguments: the stated accelerations, then the rates of the states. It raises
        ArithmeticError or ValueError where the law has no value."""
        self._refuse_faults()

    def _refuse_faults(self) -> None:
        for probe in _probes(self.arguments, self.states):
            if not _is_finite(self, probe):
                fault = self._formulas.fault(self.arguments, probe) or "it has no value"
                shown = [
                    f"{name} = {value:.3g}"
                    for name, value in zip(self.arguments, probe, strict=True)
                    if name in self.used
                ]
                raise ExpressionError(f"{fault}, at {', '.join(shown[:_SHOWN]) or 'any state'}")


def variables(objects: Sequence[str]) -> Iterator[str]:
    """Yield the names that stand for the motion of objects and the loads on them, such as `object_1_vx`."""
    for name in objects:
        yield from (f"{name}_{quantity}" for quantity in (*PLACES, *SPEEDS, *LOADS))


def _probes(arguments: Sequence[str], states: Mapping[str, float]) -> Iterator[list[float]]:
    """Yield the test states, each as a list of arguments, at which a law is evaluated. All laws get the same values."""
    for number in range(_PROBES):
        yield [
            states[name] if name in states else random.Random(f"{number}:{name}").uniform(*_range(name))  # noqa: S311 - reproducible, not secret
            for name in arguments
        ]


def _range(name: str) -> tuple[float, float]:
    return next((bounds for end, bounds in _RANGES.items() if name == end or name.endswith(f"_{end}")), _USUAL)


def _is_finite(law: StatedLaw, values: Sequence[float]) -> bool:
    try:
        return all(map(math.isfinite, law.rates(*values)))
    except (ArithmeticError, ValueError):
        return False


def _mapping(field: str, value: object, names: Sequence[str] = ()) -> dict[str, Any]:
    """Check that a value is a JSON object, and that its field names are among `names` if these are given; return it."""
    if not isinstance(value, dict) or not all(isinstance(name, str) for name in cast("dict[Any, Any]", value)):
        raise ExpressionError(f"{field} must be an object{f' with the fields {_listed(names)}' if names else ''}")
    found = cast("dict[str, Any]", value)
    if names and (unknown := [name for name in found if name not in names]):
        raise ExpressionError(f"{field} has no field {unknown[0][:40]!r}; its fields are {_listed(names)}")
    return found


def _listed(names: Sequence[str]) -> str:
    return ", ".join(names)


def _shown(name: str) -> str:
    """Return the beginning of a name from an agent. Lone surrogates are replaced, because no reply can contain them."""
    return name[:40].encode("ascii", "backslashreplace").decode()


def _text(field: str, value: object) -> str:
    if isinstance(value, str) and value.strip():
        return value
    if isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < 1e300:
        return repr(float(value))
    raise ExpressionError(f"{field} must be an expression, such as '-0.4*object_1_vx', or a number")


def _start(name: str, value: object) -> float:
    if isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < 1e300:
        return float(value)
    raise ExpressionError(f"state.{name}.start must be a number")
