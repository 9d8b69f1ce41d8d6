"""Checks on the compiled MJCF model of a pack: start contacts, energy, effective friction, parts without a joint.

The checks use the start state and simulations without tool calls. They call MuJoCo directly, without `World`.
"""

# MuJoCo ships no type stubs.
# pyright: reportAttributeAccessIssue=false, reportUnknownArgumentType=false, reportUnknownMemberType=false
# pyright: reportUnknownParameterType=false, reportUnknownVariableType=false

import xml.etree.ElementTree as ET
from collections.abc import Iterator
from itertools import combinations

import mujoco
import numpy as np

DEEPEST_M = 1e-3
"""Greatest allowed depth of a contact at the start [m]."""
UNTOUCHED_S = 10.0
"""Simulated time without calls in which energy is checked [s]."""
_GAIN, _GAIN_J = 1e-3, 1e-6
"""Allowed energy gain: as a share of the exchanged energy, and in absolute terms [J]."""
_COUNTED = {
    "bodies": "nbody",
    "joints": "njnt",
    "degrees of freedom": "nv",
    "tendons": "ntendon",
    "parts of tendons": "nwrap",
    "equality constraints": "neq",
    "actuators": "nu",
    "activations of actuators": "na",
    "sensors": "nsensor",
}
"""Kind of part → MuJoCo field that holds the number of such parts."""
_CREATED_FRICTION = 1.0
"""Sliding friction of a created ball, MuJoCo's default."""


def started(mjcf: str) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """The compiled model and its start state.

    Raises:
        ValueError: The model does not compile.
    """
    model = mujoco.MjModel.from_xml_string(mjcf)
    model.opt.enableflags |= int(mujoco.mjtEnableBit.mjENBL_ENERGY)
    data = mujoco.MjData(model)
    if model.nkey:
        mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    return model, data


def differences(mjcf: str, other: str) -> list[str]:
    """Return the MuJoCo names of the quantities in which two models or their start states differ."""
    (first, first_start), (second, second_start) = started(mjcf), started(other)
    found = [name for name in ("qpos", "qvel") if not _close(getattr(first_start, name), getattr(second_start, name))]
    for owner, counterpart in ((first, second), (first.opt, second.opt)):
        for name in dir(owner):
            value = None if name.startswith("_") else getattr(owner, name)
            if isinstance(value, float | np.ndarray) and np.asarray(value).dtype.kind == "f":
                expected = getattr(counterpart, name)
                if np.shape(value) != np.shape(expected) or not _close(value, expected):
                    found.append(name)
    return found


def _close(first: float | np.ndarray, second: float | np.ndarray) -> bool:
    return np.allclose(first, second, rtol=1e-6, atol=1e-9)


def deepest_contact(mjcf: str) -> float:
    """Depth of the deepest contact at the start [m]."""
    _, data = started(mjcf)
    return max([0.0, *(-float(contact.dist) for contact in data.contact)])


def numbers_of_parts(mjcf: str) -> dict[str, int]:
    """Count the parts of each kind that affects the duration of a step.

    Only geoms that can collide are counted. Bodies in a fluid are a separate kind. Rows of the constraint
    solver are counted at the start state.

    Raises:
        ValueError: The model does not compile.
    """
    model, data = started(mjcf)
    return {
        **{kind: int(getattr(model, field)) for kind, field in _COUNTED.items()},
        "geoms that can collide": int(np.count_nonzero(model.geom_contype | model.geom_conaffinity)),
        "bodies in a fluid": model.nbody - 1 if model.opt.density > 0 or model.opt.viscosity > 0 else 0,
        "rows of the constraint solver at the start": int(data.nefc),
    }


def energy_gain(mjcf: str) -> float:
    """Mechanical energy gained in 10 s without calls, divided by the allowed gain.

    A value above 1 means that energy is not conserved. Worlds with wind, motors or gravity compensation count as 0.

    Source: MuJoCo `mjENBL_ENERGY`.
    """
    model, data = started(mjcf)
    if model.nu or np.any(model.opt.wind) or np.any(model.body_gravcomp):
        return 0.0
    first = highest = float(data.energy.sum())
    scale = 0.0
    for _ in range(round(UNTOUCHED_S / model.opt.timestep)):
        mujoco.mj_step(model, data)
        total, motion = float(data.energy.sum()), float(data.energy[1])
        highest, scale = max(highest, total), max(scale, motion, abs(total - first))
    return (highest - first) / max(_GAIN * scale, _GAIN_J)


def overridden(mjcf: str, *, balls_may_come: bool) -> Iterator[str]:
    """Yield a sentence for each friction or restitution of a geom that a fixture's value overrides in a contact.

    Args:
        mjcf: The model.
        balls_may_come: Whether created balls, with friction 1, can touch every geom.

    Source: MuJoCo's contact parameters. The geom of higher priority determines them; without one, the greater friction
        and a weighted mean of both `solref` apply.
    """
    root = ET.fromstring(mjcf)  # noqa: S314 - the user's pack
    written = {geom.get("name", f"geom {number}"): geom for number, geom in enumerate(root.iter("geom"), 1)}
    for name, geom in written.items():
        geom.set("name", name)
    model, _ = started(ET.tostring(root, encoding="unicode"))
    for first, second in combinations(range(model.ngeom), 2):
        fixed = [model.body_weldid[model.geom_bodyid[geom]] == 0 for geom in (first, second)]
        if not any(fixed) or not _may_touch(model, first, second):
            continue
        if model.geom_priority[first] != model.geom_priority[second]:
            continue
        names = [model.geom(geom).name for geom in (first, second)]
        for attribute, field in (("friction", "geom_friction"), ("solref", "geom_solref")):
            values = getattr(model, field)[[first, second]]
            width = 1 if attribute == "friction" else 2
            stated = [name for name in names if written[name].get(attribute) is not None]
            if stated and not np.allclose(values[0][:width], values[1][:width]):
                yield (
                    f"the {attribute} of {stated[0]} is not what acts between {names[0]} and {names[1]}:"
                    f" write the same on both, or give one of them priority"
                )
    for geom in range(model.ngeom) if balls_may_come else ():
        name = model.geom(geom).name
        friction = model.geom_friction[geom][0]
        collides = model.geom_contype[geom] or model.geom_conaffinity[geom]
        stated = written[name].get("friction") is not None
        if collides and stated and model.geom_priority[geom] < 1 and friction < _CREATED_FRICTION:
            yield f'a created ball has friction 1, which would act instead of that of {name}: give {name} priority="1"'


def _may_touch(model: mujoco.MjModel, first: int, second: int) -> bool:
    bodies = [int(model.geom_bodyid[geom]) for geom in (first, second)]
    welds = [int(model.body_weldid[body]) for body in bodies]
    if welds[0] == welds[1]:
        return False
    parents = [int(model.body_weldid[model.body_parentid[weld]]) for weld in welds]
    # MuJoCo ignores contacts between a body and its parent, unless the parent is the world.
    if (parents[0] == welds[1] or parents[1] == welds[0]) and 0 not in welds:
        return False
    excluded = {int(signature) for signature in model.exclude_signature}
    low, high = min(bodies), max(bodies)
    if (low << 16) + high in excluded:
        return False
    contype, conaffinity = model.geom_contype, model.geom_conaffinity
    return bool(contype[first] & conaffinity[second] or contype[second] & conaffinity[first])


def jointless_parts(mjcf: str) -> Iterator[str]:
    """Yield a sentence for each body that is rigidly fixed to an object, because tools treat both as one object."""
    model, _ = started(mjcf)
    for body in range(1, model.nbody):
        if model.body_parentid[body] != 0 and not model.body_jntnum[body]:
            parent = model.body(int(model.body_parentid[body])).name
            yield f"body {model.body(body).name!r} has no joint: make it geoms of {parent!r}, or give it a joint"


def movable(mjcf: str) -> set[str]:
    """Names of the bodies that can move."""
    model, _ = started(mjcf)
    return {model.body(body).name for body in range(1, model.nbody) if model.body_dofnum[body]}


def timestep(mjcf: str) -> float:
    """The model's time step [s]."""
    model, _ = started(mjcf)
    return float(model.opt.timestep)
