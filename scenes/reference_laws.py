"""Wraps the reference protocols of open worlds, so that they submit a law with the answer.

A pack's `laws` are the possible laws, as expressions of its knobs. The reference protocol infers a structure and
constants from its readings. With these in place of the knobs, the expressions are the law that the protocol submits.
`FLOOR` of `solution.py` does the inference, or the function `inferred` of a file `law.py` beside it. The content hash
of the pack omits `law.py`, because neither a key nor a certificate depends on it.
"""

import re
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

from physment_mcp.contract.stated_laws import StatedLaw
from scenes.draw import KnobValue, evaluate
from scenes.errors import PackError
from scenes.folder import PackFiles, read_pack
from scenes.law_statements import UnstatableLawError, statement_of
from scenes.model import drawn_mjcf
from scenes.pack import Pack
from scenes.protocol import ANSWER, KIND, Call, Exchanges, Protocol, Reading, imported, with_law

_SIGNED = re.compile(r"(\w+)\*(\w+)")
"""Matches a derived quantity with a random sign, such as `side*size`."""


def stating(files: PackFiles, solve: Callable[[str], Protocol]) -> Callable[[str], Protocol]:
    """Wrap a reference protocol, so that it submits its law with the answer.

    The wrapped protocol answers without a law if none can be inferred, for example because a handicap withheld too many
    readings.

    Args:
        files: The pack.
        solve: Its reference protocol.
    """

    def solved(prompt: str) -> Protocol:
        protocol, seen = solve(prompt), list[tuple[Call, Reading]]()
        calls = next(protocol, None)
        while calls is not None:
            if calls and calls[-1].tool == ANSWER and "law" not in calls[-1].arguments:
                calls = [*calls[:-1], with_law(calls[-1], inferred_law(files, seen))]
            readings = yield calls
            seen += zip(calls, readings, strict=True)
            try:
                calls = protocol.send(readings)
            except StopIteration:
                return

    solved.__doc__ = solve.__doc__
    return solved


def inferred_law(files: PackFiles, seen: Exchanges) -> dict[str, Any] | None:
    """Return the law that the reference infers from its calls and readings; None if it cannot.

    Raises:
        PackError: The pack is malformed.
    """
    pack = read_pack(files)
    solution, beside = imported(files.solution, f"physment_solution_{files.scene_id}"), files.folder / "law.py"
    inferred = getattr(getattr(solution, "FLOOR", None), "inferred", None)
    if beside.is_file():
        inferred = partial(imported(beside, f"physment_law_{files.scene_id}").inferred, solution)
    if inferred is None or not pack.laws:
        return None
    try:
        found: tuple[str, Mapping[str, float]] = inferred(seen)
        law = law_with(files, pack, *found)
        StatedLaw(law, [f"object_{listed.object_id}" for listed in pack.objects.values()])
    except (ArithmeticError, LookupError, ValueError):
        return None
    return law


def law_with(files: PackFiles, pack: Pack, structure: str, constants: Mapping[str, float]) -> dict[str, Any]:
    """Write the law of a pack with a structure and constants in place of the sampled values.

    Constants that the structure does not name keep their values at seed 0, which have no effect on its law.

    Args:
        files: The pack.
        pack: Its description.
        structure: The structure: the value of the knob `kind`.
        constants: Values of knobs and derived quantities.

    Raises:
        PackError: An expression of the pack is invalid, or its laws cannot be written as text.
    """
    given = {name: float(f"{value:.7g}") for name, value in constants.items()}
    values: dict[str, KnobValue] = {name: knob.canonical for name, knob in pack.knobs.items()} | {KIND: structure}
    for name, value in given.items():
        parts = _SIGNED.fullmatch(str(pack.derive.get(name, "")))
        if parts is not None and all(part in pack.knobs for part in parts.groups()):
            values |= {parts[1]: 1 if value >= 0 else -1, parts[2]: abs(value)}
    values |= given
    for name, expression in pack.derive.items():
        values[name] = given[name] if name in given else evaluate(files, f"derive.{name}", expression, values)
    try:
        return statement_of(drawn_mjcf(files, pack, values, canonical=False))
    except UnstatableLawError as error:
        raise PackError(files.mjcf, str(error)) from error
