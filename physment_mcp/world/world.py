"""A simulated world that can be read without disturbing it, acted on, edited and rolled back.

Readings come from a settled copy of the live state, for two reasons. `mj_forward` on the live data would change later
steps through the solver's warm start. And after `mj_step` the engine's own poses and contacts are one time step older
than its joint positions.
"""

from collections.abc import Collection, Mapping
from typing import NamedTuple

import mujoco
import numpy as np

from physment_mcp.errors import NoDifference, NotPossible, Unstable
from physment_mcp.world import editing, motion, readings
from physment_mcp.world.editing import JointKind
from physment_mcp.world.loading import carry_state, is_finite, load
from physment_mcp.world.pictures import showing
from physment_mcp.world.pictures.looks import Part
from physment_mcp.world.readings import Array, Contact, Pose, Shape, Twist

_STATE = mujoco.mjtState.mjSTATE_INTEGRATION
OVERLAP_LIMIT = 1e-3
"""Depth [m] to which a body may be placed into another."""


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


class World:
    """One MuJoCo model and its state."""

    def __init__(self, mjcf: str, timestep: float | None = None) -> None:
        self._spec, self._model, self._data = load(mjcf, timestep)
        self._scratch = mujoco.MjData(self._model)
        self._settled = False
        self._before_step: _Instant | None = None
        self._disturbed: frozenset[str] = frozenset()

    # The clock

    @property
    def time(self) -> float:
        """Simulation clock [s]."""
        return float(self._data.time)

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
        if steps > 1:
            mujoco.mj_step(self._model, self._data, steps - 1)
        self._before_step = _Instant(self._model, self._state())
        self._disturbed = frozenset()
        mujoco.mj_step(self._model, self._data)
        if not is_finite(self._data):
            raise Unstable("the simulation became unstable and was rolled back; use smaller forces or speeds")

    def save(self) -> Snapshot:
        """What `restore` needs to undo all later changes."""
        return Snapshot(self._spec, self._model, self._data, self._state(), self._before_step, self._disturbed)

    def restore(self, snapshot: Snapshot) -> None:
        """Undo everything since `save`, bit for bit."""
        if snapshot.model is not self._model:
            self._scratch = mujoco.MjData(snapshot.model)
        self._spec, self._model, self._data, state, self._before_step, self._disturbed = snapshot
        mujoco.mj_setState(self._model, self._data, state, _STATE)
        self._settled = False

    # Reading

    @property
    def bodies(self) -> tuple[str, ...]:
        """Names of all bodies but the world itself."""
        return tuple(self._model.body(index).name for index in range(1, self._model.nbody))

    def pose(self, body: str) -> Pose:
        """Pose of the body frame, world coordinates."""
        return readings.pose(self._model, self._now(), self._id(body))

    def centre(self, body: str) -> Array:
        """Centre of mass (3,) [m], world coordinates. Source: MuJoCo `xipos`."""
        return self._now().xipos[self._id(body)].copy()

    def twist(self, body: str) -> Twist:
        """Spin, and velocity of the centre of mass, world axes."""
        return readings.twist(self._model, self._now(), self._id(body))

    def acceleration(self, body: str) -> Array:
        """Change of the centre of mass's velocity over the last time step, divided by the time step (3,) [m/s²].

        Raises:
            NoDifference: No time has passed yet, or none since the body was moved, created or given a velocity.
        """
        index = self._id(body)
        if self._before_step is None or body in self._disturbed:
            raise NoDifference("there is no velocity difference yet; call step first")
        before, state = self._before_step
        earlier = self._scratch if before is self._model else mujoco.MjData(before)
        _settle(before, earlier, state)
        self._settled = self._settled and before is not self._model
        old = readings.twist(before, earlier, before.body(body).id).linear
        new = readings.twist(self._model, self._now(), index).linear
        return (new - old) / float(before.opt.timestep)

    def mass(self, body: str) -> float:
        """Mass of the body alone, without its jointed children [kg]."""
        return float(self._model.body_mass[self._id(body)])

    def inertia(self, body: str) -> Array:
        """Inertia tensor about the centre of mass, world axes (3, 3) [kg·m²]."""
        return readings.inertia(self._model, self._now(), self._id(body))

    def shape(self, body: str) -> Shape:
        """Type and bounding box."""
        return readings.shape(self._model, self._id(body))

    def density(self, body: str) -> float | None:
        """Density [kg/m³] of a body whose only geom has a density instead of a mass; None for other bodies."""
        geoms = self._spec.body(body).geoms
        return float(geoms[0].density) if len(geoms) == 1 and not np.isfinite(geoms[0].mass) else None

    def is_movable(self, body: str) -> bool:
        """Whether any joint lets the body move."""
        return motion.is_movable(self._model, self._id(body))

    def with_children(self, body: str) -> tuple[str, ...]:
        """The body and everything jointed to it, directly or not."""
        tree = {self._id(body)}
        for index in range(1, self._model.nbody):
            if int(self._model.body_parentid[index]) in tree:
                tree.add(index)
        return tuple(self._model.body(index).name for index in sorted(tree))

    def contact(self, first: str, second: str) -> Contact | None:
        """The contact between two bodies, or None."""
        return readings.contact(self._model, self._now(), self._id(first), self._id(second))

    def shown_model(self, bodies: Collection[str], parts: Collection[Part], turns: Mapping[str, Array]) -> str:
        """A model that contains only what may be seen now; see `showing.shown_model`."""
        return showing.shown_model(self._model, self._now(), bodies, parts, turns)

    def fixtures(self, objects: Collection[str]) -> frozenset[str]:
        """Fixed bodies that are neither objects nor parts of objects; see `showing.fixtures`."""
        return showing.fixtures(self._model, objects)

    def turn_at_centre(self, body: str) -> Array | None:
        """Orientation (4,) of a body that is a single geom centred on its origin; see `showing.turn_at_centre`."""
        return showing.turn_at_centre(self._model, self._now(), self._id(body))

    # Acting

    def push(self, body: str, force: Array | None = None, torque: Array | None = None) -> None:
        """Set the external force [N] and torque [N·m] at the centre of mass; None leaves one as it is.

        Source: MuJoCo `xfrc_applied`.
        """
        row = self._data.xfrc_applied[self._id(body)]
        if force is not None:
            row[:3] = force
        if torque is not None:
            row[3:] = torque
        self._settled = False

    def applied_torque(self, body: str) -> Array:
        """The external torque set now (3,) [N·m]."""
        return self._data.xfrc_applied[self._id(body), 3:].copy()

    def place(self, body: str, target: Array, obstacles: Mapping[str, str]) -> bool:
        """Move the body's origin to a place; velocities stay, jointed children ride along.

        Args:
            body: The body.
            target: World position (3,) [m].
            obstacles: Bodies that it may not overlap by more than 1 mm, or than it already does, each with the name
                that a refusal gives it.

        Returns:
            True if its joints let it move along slide axes only.

        Raises:
            NotPossible: It has no joint to move along, or it would overlap an obstacle.
        """
        index = self._id(body)
        now = self._now()
        tree = [self._id(name) for name in self.with_children(body)]
        before = readings.overlaps(self._model, now, tree)
        qpos = now.qpos.copy()
        restricted = motion.place(self._model, now, qpos, index, target)
        trial = mujoco.MjData(self._model)
        mujoco.mj_setState(self._model, trial, self._state(), _STATE)
        trial.qpos[:] = qpos
        mujoco.mj_fwdPosition(self._model, trial)
        for pair, depth in readings.overlaps(self._model, trial, tree).items():
            mine, other = (self._model.body(index).name for index in pair)
            # Hidden bodies that ride along are no obstacles: a refusal would reveal them. Neither are soft ones.
            if mine in obstacles and other in obstacles and depth > max(OVERLAP_LIMIT, before.get(pair, 0.0)):
                raise _overlap(obstacles[other])
        self._data.qpos[:] = qpos
        self._disturb()
        return restricted

    def set_velocity(self, body: str, velocity: Array) -> None:
        """Give the centre of mass a velocity [m/s], as near as the body's joints allow.

        Raises:
            NotPossible: No joint of the body can move its centre of mass.
        """
        self._data.qvel[:] = motion.velocity_rates(self._model, self._now(), self._id(body), velocity)
        self._disturb()

    def bounce(self, first: str, second: str, contact: Contact) -> float:
        """Apply the perfectly elastic impulse along the normal of a contact, and return it [N·s].

        Raises:
            NotPossible: Neither body can move along the normal.
        """
        now = self._now()
        row = readings.normal_row(self._model, now, contact.point, contact.normal, self._id(first), self._id(second))
        rates, impulse = motion.elastic_rates(self._model, now, row)
        self._data.qvel[:] = rates
        self._disturb()
        return impulse

    # Editing

    def add_ball(
        self, body: str, position: Array, density: float, radius: float, rgba: Array, obstacles: Mapping[str, str]
    ) -> None:
        """Add a free sphere; everything else keeps its state.

        Raises:
            NotPossible: It would overlap an obstacle by more than 1 mm, or its inertia is too small for the engine.
        """
        saved = self.save()
        if 0.4 * (4 / 3 * np.pi * radius**3 * density) * radius**2 < mujoco.mjMINVAL:
            raise NotPossible("so light a sphere cannot be simulated; give it a larger density or radius")
        self._replace(editing.with_ball(self._spec, body, position, density, radius, rgba))
        depths = readings.overlaps(self._model, self._now(), [self._id(body)])
        for (_, other), depth in depths.items():
            name = self._model.body(other).name
            if name in obstacles and depth > OVERLAP_LIMIT:
                self.restore(saved)
                raise _overlap(obstacles[name])
        self._disturbed |= {body}

    def remove(self, body: str) -> None:
        """Remove the body, what is jointed to it and every constraint that refers to any of it."""
        self._replace(editing.without_body(self._spec, body))

    def join(self, first: str, second: str, kind: JointKind, axis: Array | None = None) -> None:
        """Constrain two bodies at their present relative pose; see `editing.with_joint`."""
        self._replace(editing.with_joint(self._spec, self._now(), (first, second), kind, axis))

    def reveal(self, body: str) -> None:
        """Make the body's geoms opaque."""
        index = self._id(body)
        first, count = int(self._model.body_geomadr[index]), int(self._model.body_geomnum[index])
        self._model.geom_rgba[first : first + count, 3] = 1.0
        for geom in self._spec.body(body).geoms:
            geom.rgba[3] = 1.0

    def _replace(self, spec: mujoco.MjSpec) -> None:
        model = spec.compile()
        data = carry_state(self._model, self._data, model)
        self._spec, self._model, self._data = spec, model, data
        self._scratch = mujoco.MjData(model)
        self._settled = False

    def _id(self, body: str) -> int:
        return int(self._model.body(body).id)

    def _state(self) -> Array:
        state = np.empty(mujoco.mj_stateSize(self._model, _STATE))
        mujoco.mj_getState(self._model, self._data, state, _STATE)
        return state

    def _now(self) -> mujoco.MjData:
        """A settled copy of the live state; the same object until the state changes."""
        if not self._settled:
            _settle(self._model, self._scratch, self._state())
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


def _overlap(label: str) -> NotPossible:
    # Do not report the depth: it would reveal withheld sizes and positions.
    return NotPossible(f"there it would overlap {label} by more than {1000 * OVERLAP_LIMIT:g} mm")


def _settle(model: mujoco.MjModel, data: mujoco.MjData, state: Array) -> None:
    """Put `state` into `data` and bring everything derived up to date."""
    mujoco.mj_setState(model, data, state, _STATE)
    mujoco.mj_forward(model, data)
