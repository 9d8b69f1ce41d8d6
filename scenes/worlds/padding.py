"""Adds laws and bodies without effect, so that the duration of a step does not reveal the terms of a world.

All worlds of a level with the same apparatus have equal numbers of laws, bodies, function calls and operations. A world
with other attributes than its level has at least as many.
"""

import functools
import re
from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

from scenes.worlds.catalogue import forms_of, modulations_of
from scenes.worlds.drawing import MOST_LINE_TERMS
from scenes.worlds.law_texts import laws_of
from scenes.worlds.levels import difficulty_of
from scenes.worlds.parts import Apparatus
from scenes.worlds.terms import Structure, Term

_CALL, _OPERATION = re.compile(r"[a-z]\w*\(|\*\*"), re.compile(r"(?<!\*)\*(?!\*)|[-+/]")
_IN_A_ROW = 80
"""Number of function calls or operations that are chained in one expression of the padding."""


class _Cost(NamedTuple):
    """Cost of a set of laws: the number of laws, of function calls and of operations."""

    laws: int
    calls: int
    """Number of functions and powers."""
    operations: int

    def plus(self, other: "_Cost", times: int = 1) -> "_Cost":
        return _Cost(*(own + times * more for own, more in zip(self, other, strict=True)))


class Padding(NamedTuple):
    """The parts of a model that exist only for padding."""

    hidden: tuple[str, ...]
    """Names of bodies that move like hidden ones."""
    way: bool
    """Whether there is a body for the path length, which no law needs."""
    laws: tuple[Mapping[str, Any], ...]


NO_PADDING = Padding((), False, ())


def padding_of(structure: Structure, level: int) -> Padding:
    """Return the padding that gives a world the same cost as all others of its level."""
    room, difficulty = _room(structure.apparatus, level), difficulty_of(level)
    hidden = tuple(f"hidden_p{number}" for number in range(difficulty.hidden - len(structure.hidden)))
    way = difficulty.modulations > 0 and not structure.worn
    laws: list[Mapping[str, Any]] = [_inert(body) for body in (*hidden, *(("odo",) if way else ()))]
    used = _cost_of([*laws_of(structure), *laws])
    laws += [_inert("object_1")] * (room.laws - used.laws)
    return Padding(hidden, way, (*laws, _filler(structure, hidden, way, room, used)))


def _inert(body: str) -> dict[str, Any]:
    return {"on": body, "force": ["0", "0", "0"], "factor": 0}


def _filler(structure: Structure, hidden: Iterable[str], way: bool, room: _Cost, used: _Cost) -> dict[str, Any]:
    """Return a law without effect that reads every variable and performs the missing function calls and operations."""
    unseen = [*(f"hidden_{at}" for at in structure.hidden), *hidden]
    others = {f"h{number}": body for number, body in enumerate(unseen)}
    others |= {"o": "object_2"} if structure.bodies == 2 else {}
    others |= {"way": "odo"} if structure.worn or way else {}
    own = ("angle", "spin", "turn_z") if structure.apparatus is Apparatus.WHEEL else ("x", "vx", "push_x")
    read = [*own, *(f"{key}_{name}" for key in others for name in (("z", "vz") if key == "way" else ("x", "vx")))]
    read += ["o_push_x"] if structure.bodies == 2 else []
    let = {"read": "+".join(read)}
    calls = max(0, room.calls - used.calls)
    # Adding the result of a call is an operation, too.
    sums = ["sin(t)"] * calls + ["t"] * max(0, room.operations + room.calls - used.operations - calls)
    for at in range(0, len(sums), _IN_A_ROW):
        let[f"rest{at}"] = "+".join(["0", *sums[at : at + _IN_A_ROW]])
    return {"on": "object_1", "with": others, "let": let, "force": ["0", "0", "0"], "factor": 0}


def _cost_of(laws: Iterable[Mapping[str, Any]]) -> _Cost:
    listed = list(laws)
    texts = [text for law in listed for text in _texts(law)]
    calls, operations = (sum(len(part.findall(text)) for text in texts) for part in (_CALL, _OPERATION))
    return _Cost(len(listed), calls, operations)


def _texts(law: Mapping[str, Any]) -> list[str]:
    return [*law.get("let", {}).values(), *law.get("force", ()), *law.get("torque", ())]


@functools.lru_cache(100)
def _room(apparatus: Apparatus, level: int) -> _Cost:
    """Return the largest cost of laws at a level: that of the most expensive forms and modulations."""
    difficulty = difficulty_of(level)
    terms = difficulty.terms if apparatus.flat else min(difficulty.terms, MOST_LINE_TERMS)
    plain = _most(
        _cost_of(laws_of(Structure(apparatus, (Term(form.name),)))) for form in forms_of(apparatus) if not form.hidden
    )
    unseen = _most(
        _cost_of(laws_of(Structure(apparatus, (Term(form.name),)))) for form in forms_of(apparatus) if form.hidden
    )
    factor = _most(_cost_of([{"force": [f"*({part.factor})"]}]) for part in modulations_of(apparatus))
    bodies = 2 if apparatus is Apparatus.PAIR else 1
    way = _cost_of([{"force": ["20*(sqrt(b_vx**2+b_vy**2+1e-6)-vz)"]}])
    hidden = _Cost(1, max(0, unseen.calls - plain.calls), max(0, unseen.operations - plain.operations))
    found = _Cost(0, 0, 0).plus(plain, terms).plus(hidden, difficulty.hidden)
    found = found.plus(factor._replace(laws=0), difficulty.modulations * bodies)
    return found.plus(way, int(difficulty.modulations > 0))


def _most(costs: Iterable[_Cost]) -> _Cost:
    return _Cost(*map(max, zip(*costs, strict=True)))
