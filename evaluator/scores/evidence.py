"""Sources of the numbers in a text: values that calls returned, statements of intent, and arithmetic in the text."""

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from fractions import Fraction
from typing import Any, NamedTuple

from evaluator.quantities.formulas import Statement, formulas_in
from evaluator.quantities.spoken import Spoken, spoken_numbers
from evaluator.quantities.units import Unit, conversion, parse_unit
from evaluator.records.episode import Exchange, Record

FIELD_UNITS: Mapping[str, str] = {
    "sim_time": "s",
    "position": "m",
    "new_position": "m",
    "displacement": "m",
    "bounding_box": "m",
    "center_of_mass": "m",
    "contact_point": "m",
    "velocity": "m/s",
    "approach_speed": "m/s",
    "force": "N",
    "torque": "N·m",
    "mass": "kg",
    "density": "kg/m³",
    "kinetic_energy": "J",
    "potential_energy": "J",
    "rotational_energy": "J",
    "momentum": "kg·m/s",
    "angular_momentum": "kg·m²/s",
    "impulse": "N·s",
    "orientation": "1",
    "normal": "1",
    "rotation_matrix": "1",
    "angle": "rad",
    "angular_velocity": "rad/s",
    "steps": "1",
    "lab_time_left": "s",
    "calls_left": "1",
}
"""Result field → unit, from the tools' contract. A field that is not listed matches a number in any unit."""
COMPONENT_UNITS: Mapping[str, str] = {"get_acceleration": "m/s²", "compute_force": "N"}
"""Tool that returns bare `x`, `y` and `z` → unit."""
_FIELDS, _COMPONENTS = (
    {name: parse_unit(unit) for name, unit in units.items()} for units in (FIELD_UNITS, COMPONENT_UNITS)
)


class ReturnedValue(NamedTuple):
    """A number that a call returned."""

    value: float
    unit: Unit | None
    """None if the contract of the tools does not specify the unit."""
    turn: int
    """Index of the turn, from 0."""
    exchange: int
    """Index of the exchange within the turn, from 0."""
    path: str
    """JSON path in the returned content, such as `$.velocity[2]`."""


def returned_values(exchange: Exchange, turn: int, position: int) -> Iterator[ReturnedValue]:
    """Yield the numbers that a call returned; none if it was refused or not run."""
    if not exchange.returned or exchange.is_error or exchange.content is None:
        return
    for path, value in numbers_in(exchange.content):
        name = path.removeprefix("$.").partition(".")[0].partition("[")[0]
        unit = _COMPONENTS.get(exchange.call.tool) if name in {"x", "y", "z"} else _FIELDS.get(name)
        yield ReturnedValue(value, unit, turn, position, path)


def numbers_in(value: Any, path: str = "$") -> Iterator[tuple[str, float]]:
    """Yield the numbers at any depth of a JSON value, in order, each with its JSON path."""
    if isinstance(value, dict):
        for name, inner in value.items():  # pyright: ignore[reportUnknownVariableType] - JSON
            yield from numbers_in(inner, f"{path}.{name}")
    elif isinstance(value, (list, tuple)):
        for index, inner in enumerate(value):  # pyright: ignore[reportUnknownVariableType, reportUnknownArgumentType] - JSON
            yield from numbers_in(inner, f"{path}[{index}]")
    elif isinstance(value, (int, float)) and not isinstance(value, bool) and abs(value) < 1e300:
        yield path, float(value)


def exact(value: float) -> Fraction:
    """Return the number as its shortest decimal representation; 0 if it is not finite."""
    return Fraction(repr(value)) if math.isfinite(value) else Fraction(0)


_PLAN = re.compile(
    r"\b(?:(?:I|we)(?:['’]ll| will| am going to| are going to|['’](?:m|re) going to)|let me|let['’]s|let us"
    r"|(?:my|the) plan is|plan:|(?:as a )?next step[,:])",
    re.IGNORECASE,
)
_END = re.compile(r"[.!?;](?=\s|$)|\n|\b(?:because|since)\b", re.IGNORECASE)


class PlannedText(NamedTuple):
    """A statement of intent in a text, such as `I will push`.

    The fields are the index of its first character and the index after its last.
    """

    start: int
    end: int


def plans_in(text: str) -> list[PlannedText]:
    """Find the statements of intent in a text.

    Each starts at words such as `I will` and ends with the sentence or at `because`.
    """
    found: list[PlannedText] = []
    for announced in _PLAN.finditer(text):
        if found and announced.start() < found[-1].end:
            continue
        end = _END.search(text, announced.end())
        found.append(PlannedText(announced.start(), len(text) if end is None else end.start()))
    return found


def is_planned(plans: Sequence[PlannedText], position: int) -> bool:
    """Whether the character at a position belongs to a statement of intent."""
    return any(plan.start <= position < plan.end for plan in plans)


_ROUNDING = 1e-9
"""Relative error attributed to floating-point arithmetic."""
_REMEMBERED = 100
"""Number of derived values that are kept. Older ones are dropped, so that the work stays linear in the text."""


class Derivation(Record):
    """Arithmetic in the reasoning, with a number of the reasoning as its result."""

    turn: int
    """Index of the turn that states it, from 0."""
    start: int
    """Index of its first character in the turn's reasoning, from 0."""
    end: int
    """Index of the character after its result."""
    value: float
    """Result of the arithmetic, in the unit in which the number is written."""


class Derived(NamedTuple):
    """A derived number that later text may refer to."""

    unit: Unit | None
    derivation: Derivation


class TurnText:
    """The reasoning of one turn, analysed from start to end."""

    def __init__(self, turn: int, text: str, derived: list[Derived]) -> None:
        """Parse the formulas of the text.

        Args:
            turn: Index of the turn, from 0.
            text: Its reasoning.
            derived: Numbers derived in earlier turns; those of this turn are appended.
        """
        self.text = text
        self._turn, self._derived = turn, derived
        found = formulas_in(text)
        self._coefficients = found.coefficients
        self._statements = {statement.result: statement for statement in found.statements}
        self._known = dict[int, float]()

    def numbers(self) -> Iterator[Spoken]:
        """Yield the numbers that the text states, without the coefficients of formulas.

        A number that is squared counts as a magnitude, as do the operands of arithmetic whose result the text calls a
        magnitude.
        """
        spoken = [number for number in spoken_numbers(self.text) if self._digits(number) not in self._coefficients]
        unsigned = {at for statement in self._statements.values() for at in statement.squared}
        for number in spoken:
            statement = self._statements.get(self._digits(number))
            if statement is not None and number.is_magnitude:
                unsigned.update(statement.operands)
        for number in spoken:
            is_magnitude = number.is_magnitude or (number.value > 0 and self._digits(number) in unsigned)
            yield number._replace(is_magnitude=is_magnitude)

    def know(self, number: Spoken, value: float) -> None:
        """Record the value of a known number (given, returned by a call or derived), in its written unit."""
        # The sign before the digits is an operator in the arithmetic.
        self._known[self._digits(number)] = abs(value) if number.value < 0 or number.is_magnitude else value

    def derivation(self, number: Spoken) -> Derivation | None:
        """Return the arithmetic that yields a number: written directly before it, or before an earlier equal number."""
        statement = self._statements.get(self._digits(number))
        found = self._evaluated(statement, number) if statement is not None else None
        if found is None:
            found = next((before.derivation for before in reversed(self._derived) if _agrees(number, before)), None)
        else:
            self._derived.append(Derived(number.unit, found))
            del self._derived[:-_REMEMBERED]
        if found is not None:
            self.know(number, found.value)
        return found

    def _evaluated(self, statement: Statement, number: Spoken) -> Derivation | None:
        """Return the derivation if all operands are known and the arithmetic rounds to the number."""
        if not statement.operands or any(at not in self._known for at in statement.operands):
            return None
        stated, margin = float(number.value), float(number.half_unit) + _ROUNDING * abs(number.value)
        for values in ({at: self._known[at] for at in statement.operands}, {}):
            for value in _in_unit_of(number, statement, values):
                size = abs(value) if number.is_magnitude else value
                if abs(size - stated) <= margin:
                    return Derivation(turn=self._turn, start=statement.start, end=number.end, value=size)
        return None

    def _digits(self, number: Spoken) -> int:
        """Return the position of a number's first digit."""
        return number.start + (not self.text[number.start].isdigit() and self.text[number.start] != ".")


def _in_unit_of(number: Spoken, statement: Statement, values: Mapping[int, float]) -> Iterator[float]:
    """Yield the result of arithmetic in the unit of a number; also the plain result, if one of the two has no unit."""
    in_si = statement.outcome(values, in_si=True)
    if in_si is not None:
        yield in_si / float(number.si_factor)
    if number.unit is None or not statement.has_units:
        plain = statement.outcome(values, in_si=False)
        if plain is not None:
            yield plain


def _agrees(number: Spoken, before: Derived) -> bool:
    """Whether a number equals an earlier derived value, at the precision at which the number is written."""
    if number.unit is None or before.unit is None:
        factor = 1.0
    else:
        converted = conversion(before.unit, number.unit)
        if converted is None:
            return False
        factor = float(converted)
    value = factor * before.derivation.value
    size = abs(value) if number.is_magnitude else value
    return abs(size - float(number.value)) <= float(number.half_unit) + _ROUNDING * abs(size)
