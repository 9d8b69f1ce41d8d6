"""The seeded draw: values of the knobs for a seed.

The same seed gives the same values on every machine. Each knob has a random stream of its own (Mersenne Twister seeded
by SHA-512 of scene, seed and knob name, as `random.Random` documents for text seeds), and values are rounded to six
significant digits, because the last bits of `exp` and `log` differ between machines. Seed 0 is the scene as written.
"""

import ast
import math
import random
from collections.abc import Mapping
from typing import Any, cast

import simpleeval

from scenes.answer_spec import Scalar
from scenes.errors import PackError
from scenes.folder import PackFiles
from scenes.pack import Expression, Knob, Pack

KnobValue = Scalar | tuple[Scalar, ...]
"""A value of a knob; a permutation has several."""

_ATTEMPTS = 1000
_FUNCTIONS = {
    name: getattr(math, name)
    for name in (
        "sqrt",
        "sin",
        "cos",
        "tan",
        "asin",
        "acos",
        "atan",
        "atan2",
        "exp",
        "log",
        "radians",
        "degrees",
        "floor",
    )
} | {"abs": abs, "min": min, "max": max}


def draw_knobs(
    files: PackFiles, pack: Pack, seed: int, *, reseed: Mapping[str, int] | None = None
) -> dict[str, KnobValue]:
    """Values of the knobs and of the quantities derived from them.

    Args:
        files: Where the pack is, for its id and for error messages.
        pack: The pack.
        seed: 0 for the scene as written, any other whole number for a variant.
        reseed: Seeds of single knobs, in place of `seed`: for two variants that differ in these knobs alone.

    Raises:
        PackError: An expression is wrong, or no draw meets `accept_draw`.
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
    """Intermediate quantity → its value for these knobs.

    Raises:
        PackError: An expression is wrong, or gives a text.
    """
    values = {name: evaluate(files, f"steps.{name}", step.value, knobs) for name, step in pack.steps.items()}
    for name, value in values.items():
        if isinstance(value, str):
            raise PackError(files.json, f"field steps.{name}: {value!r} is no number")
    return {name: float(value) for name, value in values.items()}


def evaluate(files: PackFiles, field: str, expression: Expression, values: Mapping[str, KnobValue]) -> Scalar:
    """Arithmetic over knob values.

    Raises:
        PackError: The expression does not evaluate to a finite number or a text.
    """
    if not isinstance(expression, str):
        return expression
    names = {"pi": math.pi, **{name: list(v) if isinstance(v, tuple) else v for name, v in values.items()}}
    evaluator = cast(Any, simpleeval).EvalWithCompoundTypes(names=names, functions=_FUNCTIONS)  # it is not typed
    # By default the library also reads attributes of values, and ignores assignments with a warning.
    for kind in (ast.Attribute, ast.Assign, ast.AugAssign):
        evaluator.nodes.pop(kind, None)
    try:
        value = evaluator.eval(expression)
        finite = isinstance(value, str) or (isinstance(value, int | float) and math.isfinite(value))
    except (
        simpleeval.InvalidExpression,
        SyntaxError,
        ArithmeticError,
        LookupError,
        RecursionError,
        TypeError,
        ValueError,
    ) as error:
        raise PackError(files.json, f"field {field}: {expression!r} cannot be computed: {error}") from error
    if finite:
        return value
    raise PackError(files.json, f"field {field}: {expression!r} gives {value!r}, not a finite number or a text")


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
    # Python promises to keep only random() the same between versions, so shuffle() is not used.
    keyed = sorted((source.random(), place) for place in range(len(knob.permutation or ())))
    return tuple((knob.permutation or ())[place] for _, place in keyed)


def _six_digits(value: float) -> float:
    return float(f"{value:.6g}")
