"""Compiles MJCF text into a model at its start state, and carries the state from one compiled model to the next.

Depends only on MuJoCo specs, models and data.
"""

import copy
import functools
from collections.abc import Generator
from typing import NamedTuple

import mujoco
import numpy as np

from physment_mcp.errors import SceneError, Unstable
from physment_mcp.world.engines import delete
from physment_mcp.world.laws import BoundLaws, laws_after_edit, laws_at_start, refuse_faults
from physment_mcp.world.passive import data_of, let_act
from physment_mcp.world.readings import Array

KEPT = 256
"""Size of the cache of compiled models; an entry takes about 0.3 MB."""
STATE = mujoco.mjtState.mjSTATE_INTEGRATION
"""Components of a saved state: everything besides the model that the next step depends on."""
START_KEY = "start"
"""Name of the keyframe that holds the initial state."""


def _ignore_warning(_text: str) -> None:
    """Discard the text of engine warnings, which could name hidden bodies. `Simulation` reads the warning counters."""


# Without a handler MuJoCo writes MUJOCO_LOG.TXT into the working directory.
mujoco.set_mju_user_warning(_ignore_warning)


class CompiledScene(NamedTuple):
    """A compiled scene at its start state. Worlds share it, so it must not be modified; edits work on copies."""

    spec: mujoco.MjSpec
    model: mujoco.MjModel
    laws: BoundLaws | None
    """Laws of the scene. They act on the copies that `model_of` makes, not on this model."""
    state: Array
    """The state at the start, in the layout of `STATE`."""


def load(mjcf: str, timestep: float | None = None) -> CompiledScene:
    """Compile `mjcf`.

    Args:
        mjcf: MuJoCo XML.
        timestep: Time step to use in place of the model's own [s]; for step-halving checks.

    Raises:
        SceneError: The XML does not compile, or one of its laws is invalid.
    """
    try:
        spec = mujoco.MjSpec.from_string(mjcf)
        if timestep is not None:
            spec.option.timestep = timestep
        # By default the engine silently restarts an unstable scene at t = 0, which would hide the instability.
        spec.option.disableflags = int(spec.option.disableflags) | int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)
        _name_everything(spec)
        with_keys = spec.compile()
        started = mujoco.MjData(with_keys)
        if any(key.name == START_KEY for key in spec.keys):
            mujoco.mj_resetDataKeyframe(with_keys, started, with_keys.key(START_KEY).id)
        # A keyframe has the size of the state, so it would not fit the model after an edit.
        for key in list(spec.keys):
            delete(spec, key)
        model = spec.compile()
    except (ValueError, RuntimeError) as error:
        reason = " ".join(str(error).split())
        raise SceneError(f"the scene's XML does not compile: {reason}") from error
    data = data_of(model)
    data.time = started.time
    for field in ("qpos", "qvel", "act", "ctrl", "mocap_pos", "mocap_quat"):
        getattr(data, field)[:] = getattr(started, field)
    state = np.empty(mujoco.mj_stateSize(model, STATE))
    mujoco.mj_getState(model, data, state, STATE)
    laws = laws_at_start(spec, model)
    if laws is not None:
        refuse_faults(laws, model, data)
    return CompiledScene(spec, model, laws, state)


cached_model = functools.lru_cache(KEPT)(load)
"""`load` with an LRU cache."""


def model_of(start: CompiledScene) -> mujoco.MjModel:
    """The model for one world, with the laws of the scene acting on it.

    A scene without laws shares its compiled model. Laws act on a copy: while a model with laws exists, the engine runs
    the callback in every step of every model, so cached models have no laws.
    """
    if start.laws is None:
        return start.model
    model = copy.copy(start.model)
    let_act(model, start.laws)
    return model


def compiled_edit(spec: mujoco.MjSpec) -> mujoco.MjModel:
    """Compile an edited spec, with the laws whose bodies still exist.

    Raises:
        Unstable: The engine cannot simulate the model. It tries a step when it compiles, which fails for example if
            two attached bodies are hundreds of kilometres apart.
    """
    try:
        model = spec.compile()
    except ValueError as error:
        # The engine's message is not passed on, because it could name hidden bodies.
        raise Unstable("the simulation would become unstable by this change; use smaller distances") from error
    let_act(model, laws_after_edit(spec, model))
    return model


def carry_state(old: mujoco.MjModel, state: mujoco.MjData, new: mujoco.MjModel) -> mujoco.MjData:
    """Data for `new` with the clock, motion, loads and warm start of all elements that both models have, by name.

    Source: the fields of MuJoCo's `mjSTATE_INTEGRATION`. `MjSpec.recompile` is not used: it loses applied forces,
    equality switches and the solver's warm start.
    """
    data = data_of(new)
    data.time = state.time
    for index, before in _in_both(old, new, mujoco.mjtObj.mjOBJ_JOINT, new.njnt):
        positions, dofs = joint_slices(new, index)
        old_positions, old_dofs = joint_slices(old, before)
        data.qpos[positions] = state.qpos[old_positions]
        for field in ("qvel", "qacc_warmstart", "qfrc_applied"):
            getattr(data, field)[dofs] = getattr(state, field)[old_dofs]
    for index, before in _in_both(old, new, mujoco.mjtObj.mjOBJ_BODY, new.nbody):
        data.xfrc_applied[index] = state.xfrc_applied[before]
        if (place := new.body_mocapid[index]) >= 0:
            data.mocap_pos[place] = state.mocap_pos[old.body_mocapid[before]]
            data.mocap_quat[place] = state.mocap_quat[old.body_mocapid[before]]
    for index, before in _in_both(old, new, mujoco.mjtObj.mjOBJ_EQUALITY, new.neq):
        data.eq_active[index] = state.eq_active[before]
    for index, before in _in_both(old, new, mujoco.mjtObj.mjOBJ_ACTUATOR, new.nu):
        data.ctrl[index] = state.ctrl[before]
        first, earlier, count = new.actuator_actadr[index], old.actuator_actadr[before], new.actuator_actnum[index]
        data.act[first : first + count] = state.act[earlier : earlier + count]
    return data


def _in_both(old: mujoco.MjModel, new: mujoco.MjModel, kind: mujoco.mjtObj, count: int) -> Generator[tuple[int, int]]:
    """Match the elements of a kind in two models by name; yield the index in `new` and in `old` of each match."""
    for index in range(count):
        before = mujoco.mj_name2id(old, kind, mujoco.mj_id2name(new, kind, index))
        if before >= 0:
            yield index, before


def joint_slices(model: mujoco.MjModel, joint: int) -> tuple[slice, slice]:
    """Slices of a joint in qpos and in qvel."""
    kind = mujoco.mjtJoint(model.jnt_type[joint])
    position, dof = int(model.jnt_qposadr[joint]), int(model.jnt_dofadr[joint])
    sizes = {mujoco.mjtJoint.mjJNT_FREE: (7, 6), mujoco.mjtJoint.mjJNT_BALL: (4, 3)}
    n_position, n_dof = sizes.get(kind, (1, 1))
    return slice(position, position + n_position), slice(dof, dof + n_dof)


def _name_everything(spec: mujoco.MjSpec) -> None:
    """Give names to the elements without one, because states are carried over by name."""
    for kind in ("bodies", "joints", "geoms", "equalities", "actuators"):
        for index, element in enumerate(getattr(spec, kind)):
            if not element.name:
                element.name = f"unnamed_{kind}_{index}"
