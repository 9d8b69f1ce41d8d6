"""Generates the laws of a structure as expressions for the engine. The knobs of these expressions are the constants."""

import re
from collections.abc import Mapping
from typing import Any

from scenes.worlds.parts import Apparatus
from scenes.worlds.terms import Structure, Term

ODO_RATE = 20.0
"""Rate at which the smoothed path length follows the true one [1/s]."""
WALL = 30.0
"""Stiffness of the soft wall beyond the rim, or of the buffers of a rail [N/m]."""
_WORD = re.compile(r"[A-Za-z_]\w*")


def swapped(text: str, names: Mapping[str, str]) -> str:
    """Rename variables in an expression of the grammar."""
    return _WORD.sub(lambda found: names.get(found[0], found[0]), text)


def laws_of(structure: Structure) -> list[dict[str, Any]]:
    """Return the laws of all terms and of their hidden bodies, without the law of the wall."""
    laws = [law for at, term in enumerate(structure.terms) for law in _laws_of_term(structure, at, term)]
    if structure.worn:
        speeds = {Apparatus.WHEEL: "sqrt(b_spin**2+1e-6)", Apparatus.GLIDER: "sqrt(b_vx**2+1e-6)"}
        speed = speeds.get(structure.apparatus, "sqrt(b_vx**2+b_vy**2+1e-6)")
        laws.append({"on": "odo", "with": {"b": "object_1"}, "force": ["0", "0", f"{ODO_RATE:g}*({speed}-vz)"]})
    return laws


def walls_of(structure: Structure) -> list[dict[str, Any]]:
    """Return the laws of the soft wall or of the buffers; none for a wheel."""
    if structure.apparatus is Apparatus.WHEEL:
        return []
    edge = f"{structure.radius:g}"
    if structure.apparatus is Apparatus.GLIDER:
        return [{"on": "object_1", "force": [f"-{WALL:g}*(max(x-{edge}, 0)+min(x+{edge}, 0))", "0", "0"]}]
    let = {"r": "sqrt(x**2+y**2+1e-12)", "back": f"{WALL:g}*max(1-{edge}/r, 0)"}
    bodies = range(1, structure.bodies + 1)
    return [{"on": f"object_{body}", "let": let, "force": ["-back*x", "-back*y", "0"]} for body in bodies]


def _names(apparatus: Apparatus, mass: str) -> dict[str, str]:
    """Return a mapping from the grammar's name of a variable to its name in a law that acts on a body."""
    if apparatus.flat:
        return {"odo": "odo_z", "px": f"(push_x/{mass})", "py": f"(push_y/{mass})"}
    if apparatus is Apparatus.WHEEL:
        return {"odo": "odo_z", "q": "angle", "u": "spin", "pq": f"(turn_z/{mass})"}
    return {"odo": "odo_z", "q": "x", "u": "vx", "pq": f"(push_x/{mass})"}


def _laws_of_term(structure: Structure, at: int, term: Term) -> list[dict[str, Any]]:
    let, force, factors = term.written(at)
    laws: list[dict[str, Any]] = []
    for body in range(1, structure.bodies + 1):
        if not structure.acts_on(term, body):
            continue
        mass = "m" if body == 1 else "m2"
        names = _names(structure.apparatus, mass) | {f"h{at}_q": f"h{at}_x", f"h{at}_u": f"h{at}_vx"}
        written = {name: swapped(text, names) for name, text in let.items()}
        written["gain"] = "*".join((mass, *(swapped(text, names) for text in factors)))
        parts = [f"gain*({swapped(text, names)})" for text in force]
        axes = (
            {"torque": ["0", "0", *parts]}
            if structure.apparatus is Apparatus.WHEEL
            else {"force": [*parts, "0", "0"][:3]}
        )
        law: dict[str, Any] = {"on": f"object_{body}", "with": _others(at, term), "let": written, **axes}
        laws.append(law | ({"reaction": "o"} if term.kind.reaction else {}))
    if term.kind.hidden:
        laws.append(_law_of_hidden(structure.apparatus, at, term))
    return laws


def _others(at: int, term: Term) -> dict[str, str]:
    others = {f"h{at}": f"hidden_{at}"} if term.kind.hidden else {}
    others |= {"o": "object_2"} if term.kind.group == "pair" else {}
    return others | ({"odo": "odo"} if "wear" in term.modulations else {})


def _law_of_hidden(apparatus: Apparatus, at: int, term: Term) -> dict[str, Any]:
    """Return the law that moves a hidden body of 1 kg. Its expressions refer to the hidden body as `b`."""
    names = {f"h{at}_{name}": name for name in ("x", "y", "vx", "vy")} | {f"h{at}_q": "x", f"h{at}_u": "vx"}
    names |= {name: f"b_{name}" for name in ("x", "y", "vx", "vy")}
    names |= {"q": "b_angle", "u": "b_spin"} if apparatus is Apparatus.WHEEL else {"q": "b_x", "u": "b_vx"}
    force = [swapped(text, names) for text in term.hidden_at(at)]
    return {"on": f"hidden_{at}", "with": {"b": "object_1"}, "force": [*force, "0", "0"][:3]}
