"""Generates a pack from a record: the JSON and the XML that the laboratory opens."""

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any
from xml.sax.saxutils import quoteattr

from scenes.law_statements import statement_of
from scenes.pack import CANARY, Pack
from scenes.worlds.experiment import LOOK_S, LOOKS, RESOLUTION
from scenes.worlds.instrument_errors import error_names, stated_errors
from scenes.worlds.law_texts import laws_of, walls_of
from scenes.worlds.padding import NO_PADDING, Padding, padding_of
from scenes.worlds.parts import Apparatus
from scenes.worlds.questions import ABS_TOL, REL_TOL
from scenes.worlds.records import Certificate, WorldRecord
from scenes.worlds.tasks import LETTERS, asked_of, task_of
from scenes.worlds.terms import START_M, Structure

TIMESTEP_S = 0.005
"""Time step of the engine [s]."""
SALT = "noise_salt"
"""Name of the model's custom text that determines the noise of its instruments."""
ERRORS = "systematic_errors"
"""Name of the model's custom text with the systematic errors of its instruments."""
_INERT = 'contype="0" conaffinity="0"'
_AXES = {"x": "1 0 0", "y": "0 1 0", "z": "0 0 1"}
_WORD = re.compile(r"[A-Za-z_]\w*")
_NO_HAND = "no hand reaches into the apparatus"
_DISABLED = {
    "find_objects": "it would say that nothing is hidden, where something unseen may act",
    "move_object": _NO_HAND, "change_position": _NO_HAND, "set_velocity": "motion has to come from forces",
    "detect_collision": "its bounce would be an act beyond the limits", "get_acceleration": "there is no accelerometer",
    "compute_force": "there is no accelerometer", "get_kinetic_energy": "it would tell the mass",
    "get_momentum": "it would tell the mass", "get_potential_energy": "there is no weight here",
    "get_rotational_energy": "it would tell the mass", "get_angular_momentum": "it would tell the mass",
    "get_center_of_mass": "it would only repeat the position", "create_objects": "nothing can be made here",
    "delete_objects": "nothing here is to be taken away", "attach_objects": "nothing can be joined here",
}  # fmt: skip


def pack_of(record: WorldRecord, certificate: Certificate | None) -> Pack:
    """Return the pack of a world, without its laws, which are in the model.

    Args:
        record: The world.
        certificate: Certificate with the answer key; None for a laboratory, which does not need the key.
    """
    apparatus, structure = record.apparatus, record.structure
    numbers = [asked_of(apparatus, question) for question in record.questions]
    listed = range(1, structure.bodies + 1)
    name = "wheel" if apparatus is Apparatus.WHEEL else "glider" if apparatus is Apparatus.GLIDER else "puck"
    looks = record.looks
    legs = -(-looks // LOOKS)
    readings = 2 * structure.bodies
    wheel = apparatus is Apparatus.WHEEL
    quantities = ("angle", "spin") if wheel else ("position", "velocity")
    permissions = {"geom_type": True, "geom_size": True} | (
        {"body_pos": True, "angle": True, "spin": True} if wheel else {"body_pos": True}
    )
    return Pack.model_validate({
        "metadata": {
            "scene_name": "World",  # Level and index are omitted, because with the key they determine the world.
            "task": task_of(record),
            "problem_type": "computation", "description": structure.label,
        },
        "answer": list(certificate.key) if certificate else [0.0] * len(record.questions),
        "number_of_objects": structure.bodies,
        "objects": {f"object_{body}": {"name": name, "object_id": str(body)} for body in listed},
        "object_permissions": {f"object_{body}_permissions": permissions for body in listed},
        "category": "open",
        "concepts": ["inferred law", "extrapolation"],
        "answer_spec": {
            "kind": "numbers", "unit": [unit for _, unit, _ in numbers],
            "labels": [f"{letter}: {label}" for letter, (_, _, label) in zip(LETTERS, numbers, strict=False)],
            "abs_tol": ABS_TOL, "rel_tol": REL_TOL,
        },
        "requires": ["apply_torque" if wheel else "apply_force", "step", "get_position", "get_velocity"],
        "disabled_tools": _DISABLED,
        "limits": {
            "force": 0 if wheel else record.force, "torque": record.force if wheel else 0,
            "lab_time": round(looks * LOOK_S + 0.5, 2), "calls": legs * structure.bodies + looks * (1 + readings) + 4,
        },
        "instruments": {
            **dict.fromkeys(quantities, RESOLUTION),
            "noise": dict(zip(quantities, (record.noise, 2 * record.noise), strict=True)),
            **{part: {quantities[0]: getattr(record, part)} for part in ("bias", "drift") if getattr(record, part)},
        },
        "version": str(record.grammar),
        "canary": CANARY,
    })  # fmt: skip


@dataclass(frozen=True, slots=True)
class StartState:
    """An initial state that differs from that of the experiment."""

    clock: float
    """Initial simulated time [s]."""
    state: tuple[float, ...]
    """Initial values by the names of `Structure.states`."""


def mjcf_of(record: WorldRecord, *, walled: bool = True, padded: bool = True, start: StartState | None = None) -> str:
    """Return the model of a world, with its laws.

    Args:
        record: The world.
        walled: Whether there is a wall.
        padded: Whether to add the laws and bodies without effect that the model of a laboratory has.
        start: Initial state; None for that of the experiment.
    """
    padding = padding_of(record.structure, record.level) if padded else NO_PADDING
    return _model(record.structure, record.constants, padding, record.salt, walled=walled, start=start)


def law_of(structure: Structure, constants: Mapping[str, float]) -> dict[str, Any]:
    """Return the law of a structure with given constants as an agent would write it, without the wall."""
    return statement_of(_model(structure, constants, NO_PADDING, "", walled=False, start=None))


def _model(
    structure: Structure,
    constants: Mapping[str, float],
    padding: Padding,
    salt: str,
    *,
    walled: bool,
    start: StartState | None,
) -> str:
    apparatus = structure.apparatus
    parts = [_ground(apparatus, structure.radius)]
    for body in range(1, structure.bodies + 1):
        place = (0.0 if apparatus is not Apparatus.PAIR else -START_M if body == 1 else START_M, 0.0, 0.05)
        parts.append(_seen(apparatus, body, place, constants["m" if body == 1 else "m2"]))
    axes = "xy" if apparatus.flat else "x"
    parts += [_unseen(f"hidden_{at}", axes) for at in structure.hidden]
    parts += [_unseen("odo", "z")] if structure.worn or padding.way else []
    parts += [_unseen(name, axes) for name in padding.hidden]
    written = (*laws_of(structure), *(walls_of(structure) * walled), *padding.laws)
    laws = [_with_constants(law, constants) for law in written]
    return (
        f'<mujoco><compiler angle="radian"/><option timestep="{TIMESTEP_S}" integrator="RK4" gravity="0 0 0"/>'
        f'<custom><text name="{SALT}" data={quoteattr(salt)}/>'
        f'<text name="laws" data={quoteattr(json.dumps(laws, separators=(",", ":")))}/>'
        f"{_systematic(apparatus, constants)}</custom>"
        f'<worldbody><light pos="0 0 8" dir="0 0 -1"/>{"".join(parts)}</worldbody>'
        f"{'' if start is None else _key(structure, padding, start)}</mujoco>\n"
    )


def _systematic(apparatus: Apparatus, constants: Mapping[str, float]) -> str:
    """Return the XML element with the errors of the position instrument; none if it has none."""
    width = 2 if apparatus.flat else 1
    if not constants.keys() & set(error_names(width)):
        return ""
    errors = stated_errors(constants, "angle" if apparatus is Apparatus.WHEEL else "position", width)
    return f'<text name="{ERRORS}" data={quoteattr(json.dumps(errors))}/>'


def _with_constants(law: Mapping[str, Any], constants: Mapping[str, float]) -> dict[str, Any]:
    """Return a law with the values of the constants in its expressions."""
    texts = (*law.get("let", {}).values(), *law.get("force", ()), *law.get("torque", ()))
    words = {word for text in texts for word in _WORD.findall(text)}
    return {**law, "constants": {name: value for name, value in constants.items() if name in words}}


def _key(structure: Structure, padding: Padding, start: StartState) -> str:
    """Return the XML element of an initial state, with coordinates relative to the bodies' positions in the model."""
    padded = [0.0] * (padding.way + (2 if structure.apparatus.flat else 1) * len(padding.hidden))
    width, places, rates, at = 2 if structure.apparatus.flat else 1, list[float](), list[float](), 0
    away = [now - then for now, then in zip(start.state, structure.start, strict=True)]
    while at < len(away):
        size = 1 if structure.states[at] == "odo" else width
        places += away[at : at + size]
        rates += away[at + size : at + 2 * size]
        at += 2 * size
    qpos, qvel = (" ".join(f"{number:.17g}" for number in numbers) for numbers in (places + padded, rates + padded))
    return f'<keyframe><key name="start" time="{start.clock!r}" qpos="{qpos}" qvel="{qvel}"/></keyframe>'


def _ground(apparatus: Apparatus, radius: float) -> str:
    if apparatus is Apparatus.WHEEL:
        return ""
    if apparatus is Apparatus.GLIDER:
        shape = f'name="rail" type="box" size="{radius:g} 0.02 0.02" pos="0 0 -0.05" rgba="0.5 0.5 0.5 1"'
    else:
        shape = f'name="floor" type="cylinder" size="{radius:g} 0.01" pos="0 0 -0.01" rgba="0.85 0.85 0.85 1"'
    return f"<geom {shape} {_INERT}/>"


def _slides(name: str, axes: str) -> str:
    return "".join(f'<joint name="{name}_{axis}" type="slide" axis="{_AXES[axis]}"/>' for axis in axes)


def _seen(apparatus: Apparatus, body: int, place: tuple[float, float, float], mass: float) -> str:
    """Return the XML element of a body that can be pushed."""
    name, colour = f"object_{body}", "0.8 0.3 0.2 1" if body == 1 else "0.2 0.4 0.8 1"
    if apparatus is Apparatus.WHEEL:
        joints = f'<joint name="{name}_hinge" type="hinge" axis="0 0 1"/>'
        inertia = f'<inertial pos="0 0 0" mass="1" diaginertia="{mass!r} {mass!r} {mass!r}"/>'
        shape = 'size="0.5 0.05"'
    else:
        joints, inertia, shape = _slides(name, "xy" if apparatus.flat else "x"), "", f'size="0.1 0.05" mass="{mass!r}"'
    at = " ".join(f"{number:g}" for number in place)
    geom = f'<geom name="{name}_geom" type="cylinder" {shape} rgba="{colour}" {_INERT}/>'
    return f'<body name="{name}" pos="{at}">{joints}{inertia}{geom}</body>'


def _unseen(name: str, axes: str) -> str:
    """Return the XML element of a hidden body of 1 kg on slide joints."""
    geom = f'<geom name="{name}_geom" type="sphere" size="0.01" mass="1" rgba="0 0 0 0" {_INERT}/>'
    return f'<body name="{name}">{_slides(name, axes)}{geom}</body>'
