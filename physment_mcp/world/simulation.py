"""The state of a model in time: steps, snapshots, a settled copy to read from, and the exchange of the model.

Readings come from a settled copy of the live state, for two reasons. `mj_forward` on the live data would change later
steps through the solver's warm start. And after `mj_step` the engine's own poses and contacts are one time step older
than its joint positions.
"""

from typing import NamedTuple

import mujoco
import numpy as np

from physment_mcp.errors import Unstable
from physment_mcp.world import passive, readings
from physment_mcp.world.loading import carry_state, compiled_edit, is_finite, load
from physment_mcp.world.readings import Array

STATE = mujoco.mjtState.mjSTATE_INTEGRATION
"""What a saved state contains."""
_UNSTABLE = "the simulation became unstable and was rolled back; use smaller forces or speeds"


class _Instant(NamedTuple):
    """A state, and the model it belongs to."""

    model: mujoco.MjModel
    state: Array


class Snapshot(NamedTuple):
    """Everything of a world that a roll-back restores. Opaque to callers."""

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
        self._spec, self._model, self._data = load(mjcf, timestep)
        self._scratch = passive.data_of(self._model)
        self._settled = False
        self._before_step: _Instant | None = None
        self._disturbed: frozenset[str] = frozenset()
        self._revealed: frozenset[str] = frozenset()

    # The clock

    @property
    def time(self) -> float:
        """Simulation clock [s]: a whole number of time steps, without the rounding errors of their addition."""
        return round(self._step_number * self.timestep, 12)

    @property
    def _step_number(self) -> int:
        return round(self._data.time / self.timestep)

    @property
    def timestep(self) -> float:
        """Time step [s]."""
        return float(self._model.opt.timestep)

    def whole_steps(self, duration: float) -> int:
        """The nearest whole number of time steps to a duration [s], at least one."""
        return max(1, round(duration / self.timestep))

    def step(self, steps: int) -> None:
        """Advance by a number of time steps.

        Raises:
            Unstable: The state is no longer finite; the caller rolls back.

        Source: MuJoCo `mj_step(nstep)`.
        """
        self._settled = False
        # All at once: setting them one by one takes 0.3 ms, longer than all the rest of a short step.
        self._data.warning.number[:] = 0
        try:
            if steps > 1:
                mujoco.mj_step(self._model, self._data, steps - 1)
            self._before_step = _Instant(self._model, self._state())
            self._disturbed = frozenset()
            mujoco.mj_step(self._model, self._data)
        except mujoco.FatalError as error:
            raise _given_up(self._model, self._data) from error
        if not is_finite(self._data):
            raise Unstable(_UNSTABLE)

    def save(self) -> Snapshot:
        """What `restore` needs to undo all later changes."""
        return Snapshot(
            self._spec, self._model, self._data, self._state(), self._before_step, self._disturbed, self._revealed
        )

    def restore(self, snapshot: Snapshot) -> None:
        """Undo everything since `save`, bit for bit."""
        if snapshot.model is not self._model:
            self._scratch = passive.data_of(snapshot.model)
        self._spec, self._model, self._data, state = snapshot[:4]
        self._before_step, self._disturbed, self._revealed = snapshot[4:]
        mujoco.mj_setState(self._model, self._data, state, STATE)
        self._settled = False

    def _replace(self, spec: mujoco.MjSpec) -> None:
        model = compiled_edit(spec)
        data = carry_state(self._model, self._data, model)
        self._spec, self._model, self._data = spec, model, data
        self._scratch = passive.data_of(model)
        self._settled = False

    def _id(self, body: str) -> int:
        return int(self._model.body(body).id)

    def _state(self) -> Array:
        state = np.empty(mujoco.mj_stateSize(self._model, STATE))
        mujoco.mj_getState(self._model, self._data, state, STATE)
        return state

    def _now(self) -> mujoco.MjData:
        """A settled copy of the live state; the same object until the state changes."""
        if not self._settled:
            settle(self._model, self._scratch, self._state())
            self._settled = True
        return self._scratch

    def _disturb(self) -> None:
        """Note which bodies the change just made has moved or given another velocity."""
        model = self._model
        old_places = self._scratch.xpos.copy()
        old_speeds = [readings.twist(model, self._scratch, index).linear for index in range(model.nbody)]
        self._settled = False
        now = self._now()
        self._disturbed |= {
            model.body(index).name
            for index in range(1, model.nbody)
            if not np.array_equal(old_places[index], now.xpos[index])
            or not np.allclose(old_speeds[index], readings.twist(model, now, index).linear, rtol=1e-12, atol=1e-12)
        }


def settle(model: mujoco.MjModel, data: mujoco.MjData, state: Array) -> None:
    """Put `state` into `data` and bring everything derived up to date.

    Raises:
        Unstable: The engine cannot solve for the forces of this state.
    """
    mujoco.mj_setState(model, data, state, STATE)
    try:
        mujoco.mj_forward(model, data)
    except mujoco.FatalError as error:
        raise _given_up(model, data) from error


def _given_up(model: mujoco.MjModel, data: mujoco.MjData) -> Unstable:
    """The refusal when the engine stops in the middle of its work, because its equations have no stable solution.

    It leaves its stack in `data` in use then; a reset frees it, and the caller restores the state or sets another.
    """
    mujoco.mj_resetData(model, data)
    return Unstable(_UNSTABLE)
