"""Samples the values of the knobs, the hidden values of a scene, for a seed.

The same seed gives the same values on every machine. Each knob has its own random stream, a Mersenne Twister seeded
with scene, seed and knob name as text (`random.Random` hashes text seeds with SHA-512). Values are rounded to six
significant digits, because the last bits of `exp` and `log` differ between machines. Seed 0 is the scene as written.
"""

import math
import operator
import random
from collections.abc import Callable, Mapping

from physment_mcp.contract.expressions import FUNCTIONS, SIGNS, Language, names_in
from scenes.answer_spec import Scalar
from scenes.errors import PackError
from scenes.folder import PackFiles
from scenes.pack import Expression, Knob, Pack

KnobValue = Scalar | tuple[Scalar, ...]
"""A value of a knob; a permutation has several."""

_ATTEMPTS = 1000
_LARGEST = 1e300
"""Largest magnitude of an intermediate result."""
_SHOWN = 80
"""Largest number of characters of an expression that an error message quotes."""


def draw_knobs(
    files: PackFiles, pack: Pack, seed: int, *, reseed: Mapping[str, int] | None = None
) -> dict[str, KnobValue]:
    """Return the values of the knobs and of the quantities derived from them.

    Args:
        files: The files of the pack, for its id and for error messages.
        pack: The pack.
        seed: 0 for the scene as written, any other whole number for a variant.
        reseed: Seeds of single knobs that replace `seed`, to get two variants that differ only in these knobs.

    Raises:
        PackError: An expression is invalid, or no sampled values satisfy `accept_draw`.
    """
    seeds = {name: (reseed or {}).get(name, seed) for name in pack.knobs}
    for attempt in range(_ATTEMPTS):
        values: dict[str, KnobValue] = {
            name: _draw(knob, f"{files.scene_id}:{seeds[name]}:{name}:{attempt}") if seeds[name] else knob.canonical
            for name, knob in pack.knobs.items()
        }
        for name, expression in pack.derive.items():
            values[name] = evaluate(files, f"derive.{name}", expression, values)
        conditions = enumerate(pack.accept_draw)
        if all(evaluate(files, f"accept_draw.{i}", condition, values) for i, condition in conditions):
            return values
        if not any(seeds.values()):
            raise PackError(files.json, "field accept_draw: the canonical values do not meet it")
    raise PackError(files.json, f"field accept_draw: no draw of seed {seed} met it in {_ATTEMPTS} attempts")


def step_values(files: PackFiles, pack: Pack, knobs: Mapping[str, KnobValue]) -> dict[str, float]:
    """Evaluate the intermediate quantities for these knobs; returns name → value.

    Raises:
        PackError: An expression is invalid or evaluates to a string.
    """
    values = {name: evaluate(files, f"steps.{name}", step.value, knobs) for name, step in pack.steps.items()}
    for name, value in values.items():
        if isinstance(value, str):
            raise PackError(files.json, f"field steps.{name}: {value!r} is no number")
    return {name: float(value) for name, value in values.items()}


def evaluate(files: PackFiles, field: str, expression: Expression, values: Mapping[str, KnobValue]) -> Scalar:
    """Evaluate an expression over knob values, with bounded time and memory, because packs are untrusted.

    Strings can be compared and selected. Operators accept only numbers: `'%1000000000d' % 1` would take 1 GB.

    Raises:
        PackError: The expression does not evaluate to a finite number or a string, is too long, or contains syntax
            that is not allowed.
    """
    if not isinstance(expression, str):
        return expression
    shown = repr(expression if len(expression) <= _SHOWN else f"{expression[:_SHOWN]}…")
    try:
        tree = _DRAWS.read(expression, values)
        named = {name: values[name] for name in sorted(names_in(tree) & set(values))}
        known = {name: list(value) if isinstance(value, tuple) else value for name, value in named.items()}
        (value,) = _DRAWS.compiled([*known], [tree])(*known.values())
        finite = isinstance(value, str) or (isinstance(value, int | float) and math.isfinite(value))
    except (ArithmeticError, LookupError, SyntaxError, TypeError, ValueError) as error:
        raise PackError(files.json, f"field {field}: {shown} cannot be computed: {error}") from error
    if finite:
        return value
    raise PackError(files.json, f"field {field}: {shown} gives {value!r}, not a finite number or a text")


def _power(base: float, exponent: float) -> float:
    if isinstance(base, int) and isinstance(exponent, int) and abs(base) > 1:
        # Powers of integers may have any number of digits, so the size of the result is estimated first.
        _refuse_large(exponent * math.log2(abs(base)), math.log2(_LARGEST))
    return base**exponent


def _on_numbers(compute: Callable[..., float]) -> Callable[..., float]:
    """Wrap an operator so that it accepts only numbers and bounds its result."""

    def bounded(*operands: object) -> float:
        if not all(isinstance(operand, int | float) for operand in operands):
            raise TypeError("only numbers can be computed with")
        result = compute(*operands)
        _refuse_large(abs(result), _LARGEST)
        return result

    return bounded


def _refuse_large(size: float, most: float) -> None:
    if size > most:
        raise OverflowError("a number becomes too large")


_OPERATORS = {"+": "add", "-": "sub", "*": "mul", "/": "truediv", "//": "floordiv", "%": "mod", "negative": "neg"}
_DRAWS = Language(
    signs=SIGNS | {"//", "in", "not in", "[", "]", "'"},
    # These functions return an int for an int, so that the result can be an index of a list.
    functions={**FUNCTIONS, "abs": (abs, 1, 1), "floor": (math.floor, 1, 1), "min": (min, 1, 20), "max": (max, 1, 20)},
    operators={sign: _on_numbers(getattr(operator, name)) for sign, name in _OPERATORS.items()}
    | {"**": _on_numbers(_power)},
    number=lambda text: int(text) if text.isdecimal() else float(text),
)


def _draw(knob: Knob, stream: str) -> KnobValue:
    source = random.Random(stream)  # noqa: S311 - a reproducible draw, not a secret
    if knob.uniform is not None:
        low, high = knob.uniform
        return _six_digits(low + (high - low) * source.random())
    if knob.log_uniform is not None:
        low, high = knob.log_uniform
        return _six_digits(low * (high / low) ** source.random())
    if knob.choice is not None:
        return knob.choice[int(source.random() * len(knob.choice))]
    # shuffle() is not used, because Python guarantees equal results in all versions only for random().
    keyed = sorted((source.random(), place) for place in range(len(knob.permutation or ())))
    return tuple((knob.permutation or ())[place] for _, place in keyed)


def _six_digits(value: float) -> float:
    return float(f"{value:.6g}")
