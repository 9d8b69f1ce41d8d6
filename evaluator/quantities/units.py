"""Parses units of mechanics as people write them, and converts between them. Independent of answers and tools.

General unit libraries are not used, because they would make wrong answers right: they treat the radian as 1 and convert
`3 Hz` to `3 rad/s` without warning, and their prefixes turn ordinary words into units (`cat` becomes a
centi-technical-atmosphere). Here angle is a separate dimension, and a word that is not in the table is not a unit.
"""

import math
import re
from collections.abc import Iterator
from fractions import Fraction
from typing import NamedTuple

MAX_UNIT_CHARS = 60
"""Longest text that is parsed as a unit."""

_CYCLE = Fraction(2 * math.pi)
_TORQUE_OR_ENERGY = (2, 1, -2)
"""Dimensions of both torque and energy."""
_DEGREE = Fraction(math.pi) / 180


class Unit(NamedTuple):
    """A unit as a factor to coherent SI and the exponents of its dimensions."""

    scale: Fraction
    """Factor to metre, kilogram and second, without the angular part."""
    dimensions: tuple[int, int, int]
    """Exponents of length, mass and time."""
    angle: int = 0
    """Exponent of angle."""
    angle_scale: Fraction = Fraction(1)
    """Factor of the angular part to the radian."""
    energy: int = 0
    """Number of factors that are units of energy or power minus units of force; distinguishes `J` from `N·m`."""

    def power(self, exponent: int) -> "Unit":
        """The unit raised to a whole power."""
        length, mass, time = self.dimensions
        return Unit(
            self.scale**exponent,
            (length * exponent, mass * exponent, time * exponent),
            self.angle * exponent,
            self.angle_scale**exponent,
            self.energy * exponent,
        )

    def times(self, other: "Unit") -> "Unit":
        """The product of two units."""
        (length, mass, time), (more_length, more_mass, more_time) = self.dimensions, other.dimensions
        return Unit(
            self.scale * other.scale,
            (length + more_length, mass + more_mass, time + more_time),
            self.angle + other.angle,
            self.angle_scale * other.angle_scale,
            self.energy + other.energy,
        )


_ONE = Unit(Fraction(1), (0, 0, 0))
_PREFIXES = {
    "n": ("nano", Fraction(1, 10**9)),
    "u": ("micro", Fraction(1, 10**6)),
    "m": ("milli", Fraction(1, 1000)),
    "c": ("centi", Fraction(1, 100)),
    "": ("", Fraction(1)),
    "k": ("kilo", Fraction(1000)),
    "M": ("mega", Fraction(10**6)),
    "G": ("giga", Fraction(10**9)),
}
_PREFIXED = {
    "m": (("metre", "meter"), Unit(Fraction(1), (1, 0, 0))),
    "g": (("gram",), Unit(Fraction(1, 1000), (0, 1, 0))),
    "s": (("second", "sec"), Unit(Fraction(1), (0, 0, 1))),
    "N": (("newton",), Unit(Fraction(1), (1, 1, -2), energy=-1)),
    "J": (("joule",), Unit(Fraction(1), _TORQUE_OR_ENERGY, energy=1)),
    "W": (("watt",), Unit(Fraction(1), (2, 1, -3), energy=1)),
    "Pa": (("pascal",), Unit(Fraction(1), (-1, 1, -2))),
    "Hz": (("hertz",), Unit(Fraction(1), (0, 0, -1), 1, _CYCLE)),
    "rad": (("radian",), Unit(Fraction(1), (0, 0, 0), 1)),
}
_FOOT = Unit(Fraction(3048, 10000), (1, 0, 0))
_POUND_KG = Fraction("0.45359237")
_STANDARD_GRAVITY = Fraction("9.80665")
_PLAIN = {
    "1": _ONE,
    "%": Unit(Fraction(1, 100), (0, 0, 0)),
    "percent": Unit(Fraction(1, 100), (0, 0, 0)),
    "min": Unit(Fraction(60), (0, 0, 1)),
    "minute": Unit(Fraction(60), (0, 0, 1)),
    "h": Unit(Fraction(3600), (0, 0, 1)),
    "hr": Unit(Fraction(3600), (0, 0, 1)),
    "hour": Unit(Fraction(3600), (0, 0, 1)),
    "t": Unit(Fraction(1000), (0, 1, 0)),
    "tonne": Unit(Fraction(1000), (0, 1, 0)),
    "L": Unit(Fraction(1, 1000), (3, 0, 0)),
    "litre": Unit(Fraction(1, 1000), (3, 0, 0)),
    "liter": Unit(Fraction(1, 1000), (3, 0, 0)),
    "kph": Unit(Fraction(1000, 3600), (1, 0, -1)),
    "mps": Unit(Fraction(1), (1, 0, -1)),
    "mph": Unit(Fraction("0.44704"), (1, 0, -1)),
    "ft": _FOOT,
    "foot": _FOOT,
    "feet": _FOOT,
    # A pound is a mass, as in SI tables; the force is always written lbf.
    "lb": Unit(_POUND_KG, (0, 1, 0)),
    "lbs": Unit(_POUND_KG, (0, 1, 0)),
    "lbf": Unit(_POUND_KG * _STANDARD_GRAVITY, (1, 1, -2), energy=-1),
    "kgf": Unit(_STANDARD_GRAVITY, (1, 1, -2), energy=-1),
    # `Cal` is no unit here, because it may mean cal or kcal.
    "cal": Unit(Fraction("4.184"), _TORQUE_OR_ENERGY, energy=1),
    "kcal": Unit(Fraction(4184), _TORQUE_OR_ENERGY, energy=1),
    "°": Unit(Fraction(1), (0, 0, 0), 1, _DEGREE),
    "deg": Unit(Fraction(1), (0, 0, 0), 1, _DEGREE),
    "degree": Unit(Fraction(1), (0, 0, 0), 1, _DEGREE),
    "rev": Unit(Fraction(1), (0, 0, 0), 1, _CYCLE),
    "revolution": Unit(Fraction(1), (0, 0, 0), 1, _CYCLE),
    "turn": Unit(Fraction(1), (0, 0, 0), 1, _CYCLE),
    "cycle": Unit(Fraction(1), (0, 0, 0), 1, _CYCLE),
    "rpm": Unit(Fraction(1, 60), (0, 0, -1), 1, _CYCLE),
}
_RUN_TOGETHER = {"Nm": "N*m", "kNm": "kN*m", "Ns": "N*s", "Js": "J*s"}


def _table() -> dict[str, Unit]:
    table = dict(_PLAIN)
    for symbol, (names, unit) in _PREFIXED.items():
        for short, (long, factor) in _PREFIXES.items():
            scaled = unit._replace(scale=unit.scale * factor)
            table[short + symbol] = scaled
            table.update({long + name: scaled for name in names})
    # Only names have plurals: the plural of a symbol ("ms", "Ns") would be a different unit.
    table.update({f"{name}s": unit for name, unit in tuple(table.items()) if len(name) > 3 and name.isalpha()})
    return table


_UNITS = _table()
_SPELLINGS = (
    ("µ", "u"),
    ("μ", "u"),
    ("·", "*"),
    ("⋅", "*"),
    ("×", "*"),
    ("**", "^"),
    ("²", "^2"),
    ("³", "^3"),
    ("⁻¹", "^-1"),
    ("⁻^", "^-"),
    ("−", "-"),
)
_WORDS = (
    (re.compile(r"\bper\b", re.IGNORECASE), "/"),
    (re.compile(r"\s*\bsquared\b", re.IGNORECASE), "^2"),
    (re.compile(r"\s*\bcubed\b", re.IGNORECASE), "^3"),
    (re.compile(r"\b(?:square|sq)\s+([A-Za-z]+)", re.IGNORECASE), r"\1^2"),
    (re.compile(r"\bcubic\s+([A-Za-z]+)", re.IGNORECASE), r"\1^3"),
    (re.compile(r"(?<=[A-Za-z])[-.](?=[A-Za-z])"), "*"),
)
_TOKEN = re.compile(
    r"\s*(?:(?P<name>[A-Za-z]+|[%°]|1(?![0-9]))(?:\^?\(?(?P<power>[+-]?[1-9])\)?)?|(?P<mark>[*/()]))\s*"
)


def _tokens(text: str) -> Iterator[Unit | str]:
    """Yield units raised to their powers, and the operators and brackets between them.

    Raises:
        ValueError: A part of the text is neither.
    """
    position = 0
    while position < len(text):
        token = _TOKEN.match(text, position)
        if token is None:
            raise ValueError(text[position:])
        position = token.end()
        if token["mark"]:
            yield token["mark"]
            continue
        name = token["name"]
        if name == "1" and token.start():
            raise ValueError(text)
        unit = _UNITS.get(name) or (_UNITS.get(name.lower()) if len(name) > 3 else None)
        if unit is None:
            raise ValueError(name)
        yield unit.power(int(token["power"] or 1))


def _product(parts: Iterator[Unit | str], *, inside: bool = False) -> Unit:
    """Multiply and divide from left to right, as in `m/s/s`, up to the end or to the closing bracket.

    Raises:
        ValueError: An operator lacks a unit on one side, or brackets do not match.
    """
    result, sign, open_mark = _ONE, 1, True
    for part in parts:
        if isinstance(part, Unit) or part == "(":
            unit = part if isinstance(part, Unit) else _product(parts, inside=True)
            result = result.times(unit.power(sign))
            open_mark = False
            sign = 1
        elif part == ")" and inside and not open_mark:
            return result
        elif part in "*/" and not open_mark:
            sign, open_mark = (-1 if part == "/" else 1), True
        else:
            raise ValueError(part)
    if inside or open_mark:
        raise ValueError("unfinished")
    return result


def parse_unit(text: str) -> Unit | None:
    """Parse a unit such as `m/s^2`, `kg·m²`, `N m`, `metres per second` or `km/h`; None if the text is not a unit."""
    text = text.strip()
    if not 0 < len(text) <= MAX_UNIT_CHARS:
        return None
    for written, meant in _SPELLINGS:
        text = text.replace(written, meant)
    for word, meant in _WORDS:
        text = word.sub(meant, text)
    text = re.sub(r"[A-Za-z]+", lambda name: _RUN_TOGETHER.get(name[0], name[0]), text)
    try:
        return _product(_tokens(f"1{text}" if text.startswith("/") else text))
    except ValueError:
        return None


def same_quantity(written: Unit, asked: Unit) -> bool:
    """Whether two units can measure the same quantity: equal dimensions, and not torque against energy.

    `N·m` and `J/rad` are units of torque, `J` and `N·m·rad` of energy. `kg·m²/s²` may be either.
    """
    if conversion(written, asked) is None:
        return False
    # A factor of angle converts between energy and torque. The sign of this sum is 1 for energy and -1 for torque.
    kinds = (unit.energy + 2 * unit.angle for unit in (written, asked))
    return written.dimensions != _TORQUE_OR_ENERGY or math.prod(kinds) >= 0


def conversion(written: Unit, asked: Unit) -> Fraction | None:
    """Return the factor that converts a number from one unit to another; None if their dimensions differ.

    Torque and energy convert into each other, because work may be computed as force times distance; `same_quantity`
    distinguishes them. A unit without an angle (`1/s`, `N·m`) matches radians and cycles (`rad/s`, `Hz`) without
    conversion, as in SI. It never matches degrees.
    """
    if written.dimensions != asked.dimensions:
        return None
    scale = written.scale / asked.scale
    if written.angle == asked.angle:
        return scale * written.angle_scale / asked.angle_scale
    if written.angle and asked.angle:
        return None
    if not any(written.dimensions):
        # An angle against a pure number: only the radian equals 1; `turn` and `deg` do not.
        return scale if written.angle_scale == asked.angle_scale == 1 else None
    angular = written if written.angle else asked
    return scale if abs(angular.angle) == 1 and angular.angle_scale in {1, _CYCLE, 1 / _CYCLE} else None
