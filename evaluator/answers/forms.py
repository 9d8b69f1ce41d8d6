"""Parses the numbers and list parts of an answer, without its key.

There are two parsers. The strict one accepts only a plain number. The lenient one also accepts common notations of one
number (a unit, a label, brackets, LaTeX, a fraction, a mixed number, full-width digits, thousands separators, powers of
ten), but every character must have a meaning: `1 or 2`, `not 2`, `3 ± 1` and `4.9 m/s downward` are not numbers.
"""

import json
import math
import re
from collections.abc import Iterable, Sequence
from decimal import Decimal
from fractions import Fraction
from typing import Any, NamedTuple, cast

from pydantic import JsonValue

from evaluator.quantities.units import Unit, parse_unit

MAX_CHARS = 2000
"""Longest answer that is parsed; no key of the published suite needs more than 50 characters."""

_MAX_INTEGER = 10**300
Item = str | int | float
"""One part of an answer."""

_DIGITS = r"(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)"
_PLAIN = re.compile(rf"[+-]?{_DIGITS}(?:[eE][+-]?[0-9]{{1,4}})?")


class PlainNumber(NamedTuple):
    """A number written without a unit, label or other notation."""

    value: Fraction
    """Exact value of the written decimal, so that an answer exactly on the tolerance bound is right."""
    text: str
    """The number as written."""

    @property
    def half_unit(self) -> Fraction:
        """Half a unit in the last written decimal place."""
        exponent = Decimal(self.text).as_tuple().exponent
        return Fraction(10) ** int(exponent) / 2

    @property
    def significant_digits(self) -> int:
        """Number of written digits, from the first non-zero digit."""
        return len("".join(map(str, Decimal(self.text).as_tuple().digits)).lstrip("0"))


class LenientNumber(NamedTuple):
    """A number written in one of the common notations."""

    value: Fraction
    unit: Unit | None
    label: str
    """The label before the number, in lower case; empty if there is none."""


def is_too_long(answer: JsonValue) -> bool:
    """Whether an answer has more than `MAX_CHARS` characters or parts."""
    if isinstance(answer, str):
        return len(answer) > MAX_CHARS
    if isinstance(answer, (list, dict)):
        parts = answer if isinstance(answer, list) else [*answer, *answer.values()]
        return len(answer) > MAX_CHARS or sum(len(part) for part in parts if isinstance(part, str)) > MAX_CHARS
    return False


def as_item(value: JsonValue) -> Item | None:
    """Return a value as one part of an answer; None for booleans, null, containers and too large numbers."""
    if isinstance(value, bool) or (isinstance(value, int) and abs(value) > _MAX_INTEGER):
        return None
    return value if isinstance(value, (str, int, float)) else None


def plain_number(item: Item) -> PlainNumber | None:
    """Parse a JSON number, or a string that is exactly one plain decimal number; None for anything else."""
    if isinstance(item, str):
        text = item.strip()
        if not _PLAIN.fullmatch(text):
            return None
    elif as_item(item) is None:
        return None
    else:
        text = str(item)
    number = float(text)
    return PlainNumber(Fraction(repr(number)), text) if math.isfinite(number) else None


def strict_items(answer: JsonValue) -> list[Item] | None:
    """Split a JSON list, a JSON list in a string, or a comma-separated string into parts; None for anything else."""
    if isinstance(answer, list):
        return _all_items(as_item(part) for part in answer)
    if not isinstance(answer, str):
        return None
    text = answer.strip()
    listed = text.startswith("[") and text.endswith("]")
    parts = [part.strip() for part in (text[1:-1] if listed else text).split(",")]
    if listed:
        parts = [part[1:-1] if len(part) > 1 and part[0] == part[-1] == '"' else part for part in parts]
    return _all_items(part or None for part in parts)


def _all_items(parts: Iterable[Item | None]) -> list[Item] | None:
    found = list(parts)
    items = [part for part in found if part is not None]
    return items if len(items) == len(found) else None


# The lenient parser.

_FRACTION_SLASH = "\N{FRACTION SLASH}"

_LATEX = (
    (
        re.compile(
            r"\\(?:text|mathrm|mathbf|mathit|textbf|boxed|operatorname|rm|,|;|:|!|left|right|displaystyle)(?![a-z])"
        ),
        " ",
    ),
    (re.compile(r"\\(?:SI|qty)\s*\{([^{}]*)\}\s*\{([^{}]*)\}"), r" \1 \2 "),
    (re.compile(r"\^\s*\{([^{}]*)\}"), r"^\1"),
    (re.compile(r"_\s*\{([^{}]*)\}"), r"_\1"),
    # `3\frac{1}{2}` is a product to some and 3.5 to others, so a typeset fraction is never part of a mixed number.
    (re.compile(r"\\[dt]?frac\s*\{\s*([0-9.]+)\s*\}\s*\{\s*([0-9.]+)\s*\}"), rf" \1{_FRACTION_SLASH}\2"),
    (re.compile(r"\\[dt]?frac\s*\{([^{}]*)\}\s*\{([^{}]*)\}"), r" \1/\2"),
    (re.compile(r"\\(?:times|cdot)(?![a-z])"), "*"),
    (re.compile(r"\^?\\circ(?![a-z])"), "°"),
    (re.compile(r"\\(?:approx|simeq|sim)(?![a-z])"), "≈"),
    (re.compile(r"\\(mu|omega|theta|alpha|tau|rho|lambda|delta|Delta|phi|eta|zeta)(?![a-z])"), r"\1"),
    (re.compile(r"\\([()\[\]%_ ])"), r"\1"),
    (re.compile(r"[${}~]"), " "),
    (re.compile(r"([⁰¹²³⁴⁵⁶⁷⁸⁹⁻⁺]+)"), r"^\1"),
)
_SIGNS = str.maketrans(
    "⁰¹²³⁴⁵⁶⁷⁸⁹⁻⁺−\N{EN DASH}×·⋅\N{NO-BREAK SPACE}\N{NARROW NO-BREAK SPACE}\N{THIN SPACE}０１２３４５６７８９．＋－",
    "0123456789-+--***   0123456789.+-",
) | {ord(sign): f" {text}" for sign, text in {"½": "1/2", "¼": "1/4", "¾": "3/4", "⅓": "1/3", "⅔": "2/3"}.items()}
_PAIRS = (("**", "**"), ("(", ")"), ("[", "]"), ('"', '"'), ("'", "'"), ("`", "`"), ("“", "”"))
_LABEL = re.compile(r"(?P<label>[^=:≈]{0,80}?)(?:[=:≈]|(?<![A-Za-z])(?:is|equals)(?![A-Za-z]))\s?(?P<rest>.*)")
_ABOUT = re.compile(r"(?:approximately|approx\.?|about|roughly|around) ", re.IGNORECASE)
_SYMBOL = re.compile(r"[a-zα-ω][0-9]?|mu|omega|theta|alpha|tau|rho|lambda|delta|phi|eta|zeta|ke|pe|cm")
_LABEL_WORDS = frozenset(
    re.findall(
        r"\w+",
        # Words that may label a result. The list is fixed, because any other word could negate or weaken the number.
        """
        a an at by for in of on the its my final initial answer result value total net mean average maximum minimum
        max min magnitude size component coefficient constant ratio fraction share difference change loss amount
        number position coordinate height length distance displacement radius diameter depth angle tilt range rise sag
        extension time period duration frequency rate speed velocity acceleration deceleration angular linear terminal
        launch orbital mass weight load density force tension normal contact friction static kinetic torque moment
        inertia momentum impulse energy work power potential rotational elastic spring stiffness damping restitution
        decrement logarithmic critical object body ball block cart puck glider disk disc wheel bob sphere box rod beam
        pendulum pair system ground x y z
        """,
    )
)
_GROUPED = r"[+-]? ?[1-9][0-9]{0,2}(?:(?:,[0-9]{3})+|(?: [0-9]{3})+)(?:\.[0-9]*)?(?![0-9])"
_EXPONENT = r"\(?(?P<exponent>[+-]?[0-9]{1,2})(?![0-9.])\)?"
_NUMBERS = (
    # `1 250/300` may be a quotient with a thousands separator, so the numerator has at most two digits.
    re.compile(r"(?P<sign>[+-]? ?)(?P<whole>[0-9]+) (?P<top>[1-9][0-9]?) ?/ ?(?P<bottom>[1-9][0-9]{0,2})(?![0-9.])"),
    re.compile(rf"(?P<top>[+-]? ?{_DIGITS}) ?[/{_FRACTION_SLASH}] ?(?P<bottom>{_DIGITS})"),
    re.compile(rf"(?P<sign>[+-]? ?)(?:(?P<mantissa>{_DIGITS}) ?[x*] ?)?10 ?(?:\^|\*\*) ?{_EXPONENT}"),
    re.compile(rf"(?P<grouped>{_GROUPED})"),
    re.compile(rf"(?P<plain>[+-]? ?{_DIGITS}(?:[eE][+-]?[0-9]{{1,2}}(?![0-9]))?)"),
)


def plain_text(text: str) -> str:
    """Normalise a text: no LaTeX commands, ASCII signs, single spaces, and semicolons for line breaks."""
    for command, meaning in _LATEX:
        text = command.sub(meaning, text)
    lines = [" ".join(line.split()) for line in text.translate(_SIGNS).splitlines()]
    return ";".join(line for line in lines if line)


def unwrap(text: str) -> str:
    """Remove surrounding brackets, quotes, asterisks and a final full stop."""
    for _ in range(4):
        text = text.strip().removesuffix(".")
        for left, right in _PAIRS:
            if len(text) > len(left + right) and text.startswith(left) and text.endswith(right):
                text = text[len(left) : -len(right)]
                # Python writes a list of one number as `(7.85,)`.
                text = text.removesuffix(",") if left in {"(", "["} else text
    return text.strip()


def unlabel(text: str, known: Sequence[str] = ()) -> tuple[str, str]:
    """Split `v_final = 3.2` or `The answer is 2` into label and rest; the label is empty if there is none.

    Args:
        text: Text returned by `plain_text`.
        known: Labels of the scene, accepted in addition to common names of quantities.
    """
    found = _LABEL.fullmatch(text)
    if found is None:
        return "", _ABOUT.sub("", text, count=1) if _ABOUT.match(text) else text
    label = unwrap(found["label"]).lower()
    allowed = _LABEL_WORDS.union(*(_label_words(name.lower()) for name in known))
    if all(word in allowed or _SYMBOL.fullmatch(word) for word in _label_words(label)):
        rest = found["rest"]
        return label, _ABOUT.sub("", rest, count=1) if _ABOUT.match(rest) else rest
    return "", text


def _label_words(label: str) -> list[str]:
    """Split a label into words. A hyphen is a bullet or joins two words; in `-v` and `x-v` it is a minus sign."""
    words = re.sub(r"\bobject[_ ]?[0-9]{1,3}\b", "object", label).replace("_", " ")
    return re.sub(r"^- |(?<=[a-z]{2})-(?=[a-z]{2})", " ", words).split()


def lenient_number(item: Item, known_labels: Sequence[str] = ()) -> LenientNumber | None:
    """Parse one number in a common notation; None if any character is left over."""
    label, text = unlabel(unwrap(plain_text(str(item))), known_labels)
    text = unwrap(text)
    for form in _NUMBERS:
        number = form.match(text)
        if number is None:
            continue
        rest = text[number.end() :].strip()
        if rest and rest[0].isdigit() and not rest.startswith("1/"):
            continue
        unit = parse_unit(unwrap(rest)) if rest else None
        value = _value(number)
        if value is not None and (unit is not None or not rest):
            return LenientNumber(value, unit, label)
    return None


def _value(number: re.Match[str]) -> Fraction | None:
    """Value of a match of one of `_NUMBERS`; None for a division by zero, and for `2 3/2`, which is no mixed number."""
    groups = {
        name: text.replace(" ", "").replace(",", "") for name, text in number.groupdict().items() if text is not None
    }
    if "whole" in groups:
        top, bottom = int(groups["top"]), int(groups["bottom"])
        size = int(groups["whole"]) + Fraction(top, bottom)
        return None if top >= bottom else -size if groups["sign"] == "-" else size
    if "top" in groups:
        bottom = Fraction(groups["bottom"])
        return Fraction(groups["top"]) / bottom if bottom else None
    if "exponent" in groups:
        size = Fraction(groups.get("mantissa", "1")) * Fraction(10) ** int(groups["exponent"])
        return -size if groups["sign"] == "-" else size
    return Fraction(groups.get("grouped") or groups["plain"])


def lenient_items(answer: JsonValue, count: int) -> list[Item] | None:
    """Split the answer into `count` parts, with any common separator; None if it has more or fewer parts."""
    if isinstance(answer, list):
        items = strict_items(answer)
        return items if items is not None and len(items) == count else None
    item = as_item(answer)
    if item is None or count == 1:
        return None if item is None else [item]
    text = plain_text(str(item))
    label, rest = unlabel(text)
    text = rest if label and rest.startswith(("[", "(")) else text
    text, unit = _common_unit(text.removesuffix("."))
    text = unwrap(text)
    for separator in (r";", r", (?:and )?| and ", r","):
        parts = [part.strip() for part in re.split(separator, text)]
        if len(parts) == count and all(parts):
            return [part + unit for part in parts]
    return None


def labelled_items(answer: JsonValue, labels: Sequence[str]) -> list[Item] | None:
    """Return the values of a JSON object whose names are the labels, in the order of the labels.

    The object may be a string. A label such as `A: speed under 40 N` may be shortened to `A`. None if a name is
    missing, unknown or repeated.
    """
    named = _read_object(answer)
    if named is None or not labels or len(named) != len(labels):
        return None
    found: list[Item | None] = []
    for label in labels:
        values = [value for name, value in named if _folded(name) in {_folded(label), _folded(label.partition(":")[0])}]
        found.append(as_item(values[0]) if len(values) == 1 else None)
    return _all_items(found)


def _read_object(answer: JsonValue) -> list[tuple[str, JsonValue]] | None:
    """Return the names and values of a JSON object, including repeated names."""
    if isinstance(answer, str):
        try:
            # Python would silently keep the last of several values of one name.
            read: Any = json.loads(answer, object_pairs_hook=tuple)
        except (ValueError, RecursionError):
            return None
        return list(cast("tuple[tuple[str, JsonValue], ...]", read)) if isinstance(read, tuple) else None
    return list(answer.items()) if isinstance(answer, dict) else None


def _folded(name: str) -> str:
    return " ".join(name.lower().replace("_", " ").split())


def _common_unit(text: str) -> tuple[str, str]:
    """Split `(3, 4) m/s` into the list and the unit that its parts share."""
    close = max(text.rfind("]"), text.rfind(")"))
    unit = text[close + 1 :].strip()
    if text.startswith(("[", "(")) and close > 0 and unit and parse_unit(unit):
        return text[: close + 1], f" {unit}"
    return text, ""
