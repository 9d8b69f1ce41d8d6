"""Finds the numbers that prose states, with unit and precision. Independent of tools, records and verdicts."""

import re
from collections.abc import Iterator
from fractions import Fraction
from typing import NamedTuple

from evaluator.quantities.units import MAX_UNIT_CHARS, Unit, parse_unit

_NUMBER = re.compile(
    r"""
    (?<![\w.^]) (?<!\^[-+−{(]) (?<!\^[{(][-+−]) (?<![\w)]\*\*)   # not inside a word, a decimal or an exponent: x1, m^-2
    (?:(?<![)\]])(?P<sign>[-+−]))?                          # after a bracket it is an operator, not a sign
    (?P<digits>[1-9][0-9]{0,2}(?:,[0-9]{3})+(?:\.[0-9]+)?|[0-9]+(?:\.[0-9]+)?|\.[0-9]+)(?![0-9]|\.[0-9])
    (?:[eE](?P<exponent>[-+−]?[0-9]{1,2})(?![0-9])
      |\s?(?:[×x*]|\\times|\\cdot)\s?10\s?(?:\^|\*\*)\s?[{(]?(?P<power>[-+−]?[0-9]{1,2})(?![0-9])[)}]?
      |\s?[×x*]\s?10(?P<raised>[⁻⁰¹²³⁴⁵⁶⁷⁸⁹]{1,3}))?
    """,
    re.VERBOSE,
)
_COMPONENT = r"\s?[-+−]?[0-9.][0-9.eE+−-]*\s?"
_VECTOR = re.compile(rf"[\[(]{_COMPONENT}(?:,{_COMPONENT})+[\])]")
_UNIT_WORD = r"[^\s,;:!?{}\[\]=\"']*"
_UNIT = re.compile(
    r"(?:\s?\\,)?\s{0,2}(?:\\(?:text|mathrm|rm)\s?\{(?P<latex>[^{}]{1,40})\}(?P<power>\^\{?[-+]?[0-9]\}?)?|"
    rf"(?P<unit>[A-Za-zµμ°%]{_UNIT_WORD}(?: [A-Za-z*/·^]{_UNIT_WORD}){{0,3}}))"
)
_COUNTED = (
    r"iterations?|steps?|turns?|rounds?|attempts?|trials?|tries|tests?|runs?|experiments?|objects?|bodies|balls?|"
    r"blocks?"
)
_COUNTED_BEFORE = re.compile(
    rf"\b(?:{_COUNTED}|body|carts?|pucks?|spheres?|box(?:es)?|phases?|stages?|parts?|ids?|scenes?|options?|cases?|"
    r"equations?|eqs?\.?|figures?|rows?|no\.|number)[\s#(]{0,2}$",
    re.IGNORECASE,
)
_COUNTED_AFTER = re.compile(
    rf"\s?(?:more |remaining |further |other |time )?(?:{_COUNTED}|carts?|calls?|tools?|times|digits?|significant|"
    r"decimals?|equations?|unknowns?|options?|components?|values?|cases?|ways?)\b",
    re.IGNORECASE,
)
_FRACTION = re.compile(
    r"\\[dt]?frac\s?\{\s?[0-9]{1,2}\s?\}\s?\{\s?[0-9]{1,2}\s?\}"
    r"|(?<![\w.,)/^])[0-9]{1,2}\s?/\s?[0-9]{1,2}(?![\w.]*[0-9])(?!\s?/)"
)
_DIGITS = re.compile("[0-9]+")
_MAX_COEFFICIENT = 12
"""Largest numerator or denominator of a coefficient, for the 1/12 of a rod's moment of inertia."""
_SYMBOL_AFTER = re.compile(
    r"\s?\\(?:pi|sqrt|d?frac|(?:var)?theta|phi|alpha|omega|tau|mu|rho|lambda|Delta|sin|cos|tan|ln|log)(?![A-Za-z])"
)
_RANGE_BEFORE = re.compile(
    rf"\b(?:{_COUNTED}|phases?|stages?|parts?|scenes?|equations?)\s[0-9]{{1,3}}\s?(?:[-–—&]|and|to)\s?$"
)
_MAGNITUDE_BEFORE = re.compile(
    r"(?:\b(?:magnitude|speed|deceleration)\b[^.;,\n\d]{0,24}"
    r"|\b(?:drop|fall|sink|descend|decreas|shrink|los|slow)[a-z]{0,5} (?:\w{1,12} )?(?:by|of|at|with)(?: about)? ?"
    r"|\| ?)$",
    re.IGNORECASE,
)
_MAGNITUDE_AFTER = re.compile(
    r"[)\]*$\\ ]{0,4}(?:\((?:in )?magnitude|magnitude|in magnitude"
    r"|(?:straight )?(?:down|backward|leftward)(?:wards?|s)?\b|below\b"
    r"|to the left\b|(?:in|along|towards?) (?:the )?(?:negative|minus|[-−] ?[xyz]\b))",
    re.IGNORECASE,
)
_MAX_DIGITS = 40
_ENUMERATOR = re.compile(r"(?:^|\n)[ \t>*-]*$")
_NO_BRACES = str.maketrans("", "", "{}")
_RAISED_DIGITS = "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"
_RAISED = str.maketrans(_RAISED_DIGITS, "-0123456789")


class Spoken(NamedTuple):
    """A number that prose states."""

    start: int
    end: int
    """Index after the number and its unit."""
    value: Fraction
    half_unit: Fraction
    """Half a unit in the last written decimal place."""
    unit: Unit | None
    significant_digits: int
    """Number of written digits, from the first non-zero digit."""
    is_magnitude: bool
    """Whether the context makes the number unsigned: `a speed of 3 m/s`, `3 m/s downward`."""

    @property
    def si_factor(self) -> Fraction:
        """Factor from the written unit to coherent SI, radians included."""
        return Fraction(1) if self.unit is None else self.unit.scale * self.unit.angle_scale


def spoken_numbers(text: str) -> Iterator[Spoken]:
    r"""Yield the numbers that a text states, in order.

    It excludes numbers inside words and ids, exponents, whole numbers that count or label something (`iteration 3`,
    `object 2`, `3 steps`), list markers (`1.`), and the coefficients of formulas (`2/5 m r^2`, `\frac{1}{12}`, `2\pi`).
    Each component of a vector is a separate number; a unit after the vector applies to all of them.
    """
    vectors = [found.span() for found in _VECTOR.finditer(text)]
    # The commas of a vector separate numbers, not thousands.
    text = _VECTOR.sub(lambda vector: vector[0].replace(",", ";"), text)
    coefficients = _coefficients(text)
    read_to, next_vector = 0, 0
    for found in _NUMBER.finditer(text):
        start, end = found.span()
        if start < read_to or len(found["digits"]) > _MAX_DIGITS:
            continue  # inside the unit of the previous number, or too long to be a measurement
        while next_vector < len(vectors) and vectors[next_vector][1] <= start:
            next_vector += 1
        in_vector = next_vector < len(vectors) and vectors[next_vector][0] < start
        unit, unit_end = unit_at(text, end)
        after = text[end : end + 1]
        if unit is None and (after == "_" or (after.isalnum() and after not in _RAISED_DIGITS)):
            continue  # the start of a word, such as 2D or 3rd
        if not in_vector and _is_count(text, found, has_unit=unit is not None):
            continue
        # In `2/5 m r^2` the letter is a mass, not a metre.
        if start in coefficients or (unit is None and found["digits"].isdecimal() and _SYMBOL_AFTER.match(text, end)):
            continue
        read_to = unit_end
        if in_vector and unit is None:
            unit = unit_at(text, vectors[next_vector][1])[0]
        yield _spoken(found, unit_end, unit, is_magnitude=_is_magnitude(text, start, unit_end))


def _coefficients(text: str) -> frozenset[int]:
    """Return the positions of the numerators and denominators of coefficients, such as in `2/5 m r^2`."""
    fractions = (
        [(found.start() + part.start(), int(part[0])) for part in _DIGITS.finditer(found[0])]
        for found in _FRACTION.finditer(text)
    )
    return frozenset(at for parts in fractions if max(size for _, size in parts) <= _MAX_COEFFICIENT for at, _ in parts)


def _is_magnitude(text: str, start: int, end: int) -> bool:
    return bool(_MAGNITUDE_BEFORE.search(text[max(0, start - 40) : start]) or _MAGNITUDE_AFTER.match(text, end))


def _spoken(found: re.Match[str], end: int, unit: Unit | None, *, is_magnitude: bool) -> Spoken:
    digits = found["digits"].replace(",", "")
    power = found["exponent"] or found["power"] or (found["raised"] or "0").translate(_RAISED)
    scale = Fraction(10) ** int(power.replace("−", "-"))
    size = Fraction(digits) * scale
    return Spoken(
        start=found.start(),
        end=end,
        value=size if (found["sign"] or "+") == "+" else -size,
        half_unit=scale / 10 ** len(digits.partition(".")[2]) / 2,
        unit=unit,
        significant_digits=len(digits.replace(".", "").lstrip("0")),
        is_magnitude=is_magnitude and not found["sign"],
    )


def unit_at(text: str, start: int) -> tuple[Unit | None, int]:
    """Return the longest unit that starts at a position, and the position after it."""
    found = _UNIT.match(text, start, start + MAX_UNIT_CHARS)
    if found is None:
        return None, start
    if found["latex"]:
        unit = parse_unit(found["latex"] + (found["power"] or "").translate(_NO_BRACES))
        return unit, start if unit is None else found.end()
    words = found["unit"].split(" ")
    for count in range(len(words), 0, -1):
        written = " ".join(words[:count]).rstrip(".*_`$\\")
        written = written[:-1] if written.endswith(")") and "(" not in written else written
        unit = parse_unit(written)
        if unit is not None:
            return unit, found.start("unit") + len(written)
    return None, start


def _is_count(text: str, found: re.Match[str], *, has_unit: bool) -> bool:
    """Whether a whole number counts or labels something instead of measuring it."""
    if not found[0].isdecimal():
        return False
    before, after = text[max(0, found.start() - 24) : found.start()], text[found.end() : found.end() + 32]
    if _COUNTED_AFTER.match(after):
        return True
    if not has_unit and (_COUNTED_BEFORE.search(before) or _RANGE_BEFORE.search(before)):
        return True
    return after.startswith((". ", ") ", ".\n", ")\n")) and _ENUMERATOR.search(before) is not None
