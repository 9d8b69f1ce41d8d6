"""Time evolution of a model: steps, snapshots, settled data for readings, and replacement of the model after edits.

The state is an immutable array; each change creates a new one. The engine's `MjData` is a workspace. It is either
*live*, ready for the next step, or *settled*, with all derived quantities up to date. The two differ: after `mj_step`
poses and contacts are one time step older than the joint positions, and `mj_forward` changes the solver's warm start,
which would change the result of the next step. A step therefore always starts from the state array, so readings do not
influence it.
"""

import time
from collections.abc import Generator
from contextlib import contextmanager
from typing import NamedTuple

import mujoco
import numpy as np

from physment_mcp.errors import Unstable
from physment_mcp.world import passive, readings
from physment_mcp.world.loading import STATE, cached_model, carry_state, compiled_edit, model_of
from physment_mcp.world.readings import Array

_UNSTABLE = "the simulation became unstable and was rolled back; use smaller forces or speeds"
_INSTABILITY = [
    int(kind)
    for kind in (
        mujoco.mjtWarning.mjWARN_BADQPOS,
        mujoco.mjtWarning.mjWARN_BADQVEL,
        mujoco.mjtWarning.mjWARN_BADQACC,
    )
]
"""Indices of the warning counters that the engine raises when its state is no longer finite."""


class _Instant(NamedTuple):
    """A state, and the model it belongs to."""

    model: mujoco.MjModel
    state: Array


class _Motion(NamedTuple):
    """Positions of the origins and velocities of the centres of mass of all bodies (nbody, 3)."""

    places: Array
    velocities: Array


class _Recording(NamedTuple):
    """The states recorded during a `recorded` block."""

    every: int
    """Interval of the recorded states [time steps]."""
    states: list[Array]


class Snapshot(NamedTuple):
    """Everything that `restore` needs. Opaque to callers."""

    spec: mujoco.MjSpec
    model: mujoco.MjModel
    data: mujoco.MjData
    state: Array
    before_step: _Instant | None
    disturbed: frozenset[str]
    revealed: frozenset[str]


class Simulation:
    """One MuJoCo model and its state in time."""

    def __init__(self, mjcf: str, timestep: float | None = None) -> None:
        start = cached_model(mjcf, timestep)
        self._spec, self._model, self._state = start.spec, model_of(start), start.state
        self._timestep = float(self._model.opt.timestep)  # no edit changes it
        self._data = passive.data_of(self._model)
        self._is_live = self._is_settled = False
        self._before_step: _Instant | None = None
        self._disturbed: frozenset[str] = frozenset()
        self._revealed: frozenset[str] = frozenset()
        self._pace_s: float | None = None
        self._recording: _Recording | None = None

    # The clock

    @property
    def time(self) -> float:
        """Simulation clock [s]: a whole number of time steps, without the rounding errors of their addition."""
        return self.time_of(self._state)

    def time_of(self, state: Array) -> float:
        """Simulation clock of a state from `recorded` [s]."""
        return round(self._number_of(state) * self.timestep, 12)

    @property
    def _step_number(self) -> int:
        return self._number_of(self._state)

    def _number_of(self, state: Array) -> int:
        # The time is the first number of a state.
        return round(state.item(0) / self.timestep)

    @property
    def timestep(self) -> float:
        """Time step [s]."""
        return self._timestep

    def whole_steps(self, duration: float) -> int:
        """The nearest whole number of time steps to a duration [s], at least one."""
        return max(1, round(duration / self.timestep))

    @property
    def pace_s(self) -> float | None:
        """Wall time per time step [s] during the last `step`; None before the first."""
        return self._pace_s

    def step(self, steps: int) -> None:
        """Advance by a number of time steps.

        Raises:
            Unstable: The state would no longer be finite; the world is left unchanged.

        Source: MuJoCo `mj_step(nstep)`.
        """
        recording = self._recording
        if recording is None:
            self._advance(steps)
            return
        saved = self.save()
        try:
            while steps:
                part = min(steps, recording.every - self._step_number % recording.every)
                self._advance(part)
                steps -= part
                if self._step_number % recording.every == 0:
                    recording.states.append(self._state)
        except Unstable:
            self.restore(saved)
            raise

    @contextmanager
    def recorded(self, every: int) -> Generator[list[Array]]:
        """Record states while the block steps the world. Recording does not change the steps.

        Args:
            every: Interval of the recorded states [time steps]; the first and the last state are recorded too.

        Yields:
            The states, for `World.poses_at`; they are complete after the block.
        """
        recording = self._recording = _Recording(every, [self._state])
        try:
            yield recording.states
        finally:
            self._recording = None
        if recording.states[-1] is not self._state:
            recording.states.append(self._state)

    def _advance(self, steps: int) -> None:
        model, data = self._model, self._live()
        # Set all counters at once: setting them one by one takes 0.3 ms, longer than the rest of a short step.
        data.warning.number[:] = 0
        started = time.perf_counter()
        try:
            if steps > 1:
                mujoco.mj_step(model, data, steps - 1)
            before = _state_of(model, data)
            mujoco.mj_step(model, data)
        except mujoco.FatalError as error:
            raise _given_up(model, data) from error
        self._pace_s = (time.perf_counter() - started) / steps
        state = _state_of(model, data)
        if not _is_finite(data, state):
            raise Unstable(_UNSTABLE)
        self._before_step, self._disturbed = _Instant(model, before), frozenset()
        self._state, self._is_live = state, True

    def save(self) -> Snapshot:
        """Take a snapshot, from which `restore` can undo all later changes."""
        return Snapshot(
            self._spec, self._model, self._data, self._state, self._before_step, self._disturbed, self._revealed
        )

    def restore(self, snapshot: Snapshot) -> None:
        """Restore the state of a snapshot, bit for bit."""
        self._is_live = self._is_settled = False
        self._spec, self._model, self._data, self._state = snapshot[:4]
        self._before_step, self._disturbed, self._revealed = snapshot[4:]
        # A failed call may have left the engine's stack in use.
        mujoco.mj_resetData(self._model, self._data)

    def _replace(self, spec: mujoco.MjSpec) -> None:
        model = compiled_edit(spec)
        data = carry_state(self._model, self._live(), model)
        self._spec, self._model, self._data = spec, model, data
        self._keep()

    def _id(self, body: str) -> int:
        return int(self._model.body(body).id)

    def _live(self) -> mujoco.MjData:
        """Return the `MjData` with the present state, to step or change it; then call `_keep` to store it."""
        if not self._is_live:
            mujoco.mj_setState(self._model, self._data, self._state, STATE)
        # The state array stays the old one until the change is complete, so a failed change has no effect.
        self._is_live = self._is_settled = False
        return self._data

    def _keep(self) -> None:
        """Store the state that the `MjData` now contains."""
        self._state, self._is_live = _state_of(self._model, self._data), True

    def _now(self) -> mujoco.MjData:
        """Return the `MjData` with up-to-date derived quantities; it is valid until the next change of the world."""
        if not self._is_settled:
            self._is_live = False
            settle(self._model, self._data, self._state)
            self._is_settled = True
        return self._data

    def _motion(self) -> _Motion:
        model, now = self._model, self._now()
        speeds = [readings.twist(model, now, index).linear for index in range(model.nbody)]
        return _Motion(now.xpos.copy(), np.array(speeds))

    def _disturb(self, before: _Motion) -> None:
        """Record which bodies the last change moved or gave a different velocity."""
        after = self._motion()
        moved = (before.places != after.places).any(axis=1)
        turned = ~np.isclose(before.velocities, after.velocities, rtol=1e-12, atol=1e-12).all(axis=1)
        self._disturbed |= {self._model.body(index).name for index in np.flatnonzero((moved | turned)[1:]) + 1}


def _state_of(model: mujoco.MjModel, data: mujoco.MjData) -> Array:
    """Copy the state from `data` to a new array: everything that the next step depends on."""
    state = np.empty(mujoco.mj_stateSize(model, STATE))
    mujoco.mj_getState(model, data, state, STATE)
    return state


def _is_finite(data: mujoco.MjData, state: Array) -> bool:
    """Whether a state is finite and the engine raised no instability warning since the counters were cleared.

    Args:
        data: Data after a step.
        state: The state in `data`, as returned by `_state_of`.
    """
    raised = data.warning.number.tolist()  # a list is faster to index than the array
    unstable = any(raised[kind] for kind in _INSTABILITY)
    return not unstable and bool(np.isfinite(state).all()) and bool(np.isfinite(data.qacc).all())


def settle(model: mujoco.MjModel, data: mujoco.MjData, state: Array) -> None:
    """Copy `state` into `data` and update all derived quantities.

    Raises:
        Unstable: The engine cannot solve for the forces of this state.
    """
    mujoco.mj_setState(model, data, state, STATE)
    try:
        mujoco.mj_forward(model, data)
    except mujoco.FatalError as error:
        raise _given_up(model, data) from error


def _given_up(model: mujoco.MjModel, data: mujoco.MjData) -> Unstable:
    """Return the refusal for an engine error. The engine raises one when its equations have no stable solution.

    The error leaves the engine's stack in `data` in use; a reset frees it.
    """
    mujoco.mj_resetData(model, data)
    return Unstable(_UNSTABLE)
