"""What an answer says, read from how it was written: numbers, parts of lists, words. Knows no keys and no verdicts.

Two readings. The strict one takes a number for a number and nothing else. The free one also takes the forms people use
for one number (a unit, a label, brackets, LaTeX, a fraction, thousands separators, powers of ten), but must account for
every character: text with anything left over (`1 or 2`, `not 2`, `3 ± 1`, `4.9 m/s downward`) says no number.
"""

import re
from decimal import Decimal
from fractions import Fraction
from typing import NamedTuple

MAX_CHARS = 2000
"""Longer answers are not read at all; the longest key of the published suite has 47 characters."""

type_ = type  # keeps the name of the builtin free below
Scalar = str | int | float

_PLAIN = re.compile(r"[+-]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][+-]?[0-9]{1,4})?")


class Plain(NamedTuple):
    """A plain number."""

    value: Fraction
    """The decimal as written, exactly, so that a bound that is met is met."""
    text: str
    """How it was written."""

    @property
    def half_unit(self) -> Fraction:
        """Half of the last place written."""
        return Fraction(10) ** _exponent(self.text) / 2

    @property
    def significant_digits(self) -> int:
        """Digits from the first that is not 0 to the last written; 0 for a plain zero."""
        digits = "".join(map(str, Decimal(self.text).as_tuple().digits)).lstrip("0")
        return len(digits)


class Free(NamedTuple):
    """A number in one of the forms people use."""

    value: Fraction
    unit: str
    """The unit as written; empty without one."""
    label: str
    """What the number was called, lower case; empty if nothing."""
