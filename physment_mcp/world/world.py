"""A simulated world with readings, actions, edits and roll-back. Readings do not influence the simulation.

Readings are taken from settled data, through the instruments of the world.
"""

from collections.abc import Collection, Mapping, Sequence

import mujoco
import numpy as np

from physment_mcp.errors import NoDifference, NotPossible
from physment_mcp.world import clearance, editing, motion, passive, readings
from physment_mcp.world.editing import JointKind
from physment_mcp.world.loading import STATE
from physment_mcp.world.pictures import showing
from physment_mcp.world.pictures.showing import Frame, Part, ShownPart
from physment_mcp.world.readings import Array, Contact, HingeMotion, Pose, Shape, Twist
from physment_mcp.world.readout import EXACT, Readout, Sensors
from physment_mcp.world.simulation import Simulation, settle
from physment_mcp.world.systematic import read_errors

NOISE_SALT = "noise_salt"
"""Name of the model's text element with the secret salt of the instrument noise, which makes it unpredictable."""
OVERLAP_LIMIT = 1e-3
"""Largest overlap [m] with another body at which a body may be placed."""


class World(Simulation):
    """One MuJoCo model and its state, with operations on bodies by name: readings, actions and edits."""

    def __init__(self, mjcf: str, timestep: float | None = None, readout: Readout = EXACT) -> None:
        """Load the model at its start state.

        Args:
            mjcf: MuJoCo XML.
            timestep: Time step to use in place of the model's own [s]; for step-halving checks.
            readout: Resolution and noise of the instruments, and the quantities that may have a systematic error. The
                model contains these errors.

        Raises:
            SceneError: The model does not compile, or has laws or systematic errors that are not in the format.
        """
        super().__init__(mjcf, timestep)
        salts = [text.data for text in self._spec.texts if text.name == NOISE_SALT]
        readout = readout.salted(salts[0]) if salts else readout
        self.read_with(readout)

    def read_with(self, readout: Readout) -> None:
        """Replace the instruments, except for the systematic errors of the model. For certification, not for tools."""
        self._readout = readout.with_errors(read_errors(self._spec)) if readout.admitted else readout

    # Reading

    @property
    def bodies(self) -> tuple[str, ...]:
        """Names of all bodies but the world itself."""
        return tuple(self._model.body(index).name for index in range(1, self._model.nbody))

    def pose(self, body: str) -> Pose:
        """Pose of the body frame, world coordinates."""
        return self._sensors().pose(body)

    def poses_at(self, states: Sequence[Array], bodies: Sequence[str]) -> dict[str, list[Pose]]:
        """Return for each body its readings of `pose` at states that `recorded` yielded for this model."""
        data = passive.data_of(self._model)
        found: dict[str, list[Pose]] = {body: [] for body in bodies}
        for state in states:
            mujoco.mj_setState(self._model, data, state, STATE)
            mujoco.mj_kinematics(self._model, data)
            sensors = Sensors(self._readout, self._model, data, self._number_of(state))
            for body, poses in found.items():
                poses.append(sensors.pose(body))
        return found

    def _sensors(self) -> Sensors:
        return Sensors(self._readout, self._model, self._now(), self._step_number)

    def centre(self, body: str) -> Array:
        """Centre of mass (3,) [m], world coordinates."""
        return self._sensors().centre(body)

    def twist(self, body: str) -> Twist:
        """Spin, and velocity of the centre of mass, world axes."""
        return self._sensors().twist(body)

    def velocity(self, body: str) -> Array:
        """Velocity of the centre of mass (3,) [m/s], world axes."""
        return self._sensors().velocity(body)

    def turn(self, body: str) -> HingeMotion | None:
        """Joint angle and joint speed of a body with exactly one hinge among its own joints; None for other bodies."""
        return self._sensors().turn(body)

    def acceleration(self, body: str) -> Array:
        """Change of the centre of mass's velocity over the last time step, divided by the time step (3,) [m/s²].

        Raises:
            NoDifference: No time has passed yet, or none since the body was moved, created or given a velocity.
        """
        if self._before_step is None or body in self._disturbed:
            raise NoDifference("there is no velocity difference yet; call step first")
        model, state = self._before_step
        earlier = passive.data_of(model) if model is not self._model else self._live()
        settle(model, earlier, state)
        old = Sensors(self._readout, model, earlier, self._step_number - 1).velocity(body)
        return (self.velocity(body) - old) / self.timestep

    def mass(self, body: str) -> float:
        """Mass of the body alone, without its jointed children [kg]."""
        return float(self._model.body_mass[self._id(body)])

    def inertia(self, body: str) -> Array:
        """Inertia tensor about the centre of mass, world axes (3, 3) [kg·m²]."""
        return readings.inertia(self._model, self._id(body), self.pose(body).quaternion)

    def shape(self, body: str) -> Shape:
        """Type and bounding box."""
        return readings.shape(self._model, self._id(body))

    def density(self, body: str) -> float | None:
        """Density [kg/m³] of a body whose only geom has a density instead of a mass; None for other bodies."""
        geoms = self._spec.body(body).geoms
        return float(geoms[0].density) if len(geoms) == 1 and not np.isfinite(geoms[0].mass) else None

    def is_movable(self, body: str) -> bool:
        """Whether any joint lets the body move."""
        return bool(self._model.body_weldid[self._id(body)])  # 0: rigidly fixed to the world

    def with_children(self, body: str) -> tuple[str, ...]:
        """The body and everything jointed to it, directly or not."""
        tree = {self._id(body)}
        for index in range(1, self._model.nbody):
            if int(self._model.body_parentid[index]) in tree:
                tree.add(index)
        return tuple(self._model.body(index).name for index in sorted(tree))

    def contact(self, first: str, second: str) -> Contact | None:
        """The contact between two bodies, or None."""
        return self._sensors().contact(first, second)

    def shown_parts(
        self, frames: Mapping[str, Frame], parts: Collection[Part], turns: Mapping[str, Array]
    ) -> dict[str, list[ShownPart]]:
        """The visible geoms at the present state, by body; see `showing.shown_parts`."""
        return showing.shown_parts(self._model, self._now(), frames, parts, turns, self._revealed)

    def fixtures(self, objects: Collection[str]) -> frozenset[str]:
        """Fixed bodies that are neither objects nor parts of objects; see `showing.fixtures`."""
        return showing.fixtures(self._model, objects)

    def turn_at_centre(self, body: str) -> Array | None:
        """Orientation (4,) of a body that is a single geom centred on its origin; see `showing.turn_at_centre`."""
        return showing.turn_at_centre(self._model, self._now(), self._id(body))

    # Acting

    def push(self, body: str, force: Array | None = None, torque: Array | None = None) -> None:
        """Set the external force [N] and torque [N·m] at the centre of mass; None leaves a value unchanged.

        Source: MuJoCo `xfrc_applied`.
        """
        row = self._live().xfrc_applied[self._id(body)]
        if force is not None:
            row[:3] = force
        if torque is not None:
            row[3:] = torque
        self._keep()

    def applied_torque(self, body: str) -> Array:
        """The external torque set now (3,) [N·m]."""
        return self._now().xfrc_applied[self._id(body), 3:].copy()

    def place(self, body: str, target: Array, obstacles: Mapping[str, str]) -> bool:
        """Move the body's origin to a position. Velocities do not change, and bodies jointed to the body move with it.

        Args:
            body: The body.
            target: World position (3,) [m]; rounded to the resolution of positions.
            obstacles: Body that the placed body may not overlap → name to use in a refusal. An overlap of up to 1 mm,
                or up to the present overlap, is allowed. Depths have the resolution of the instruments (`clearance`).

        Returns:
            True if the body reached the target, False if its joints did not allow it.

        Raises:
            NotPossible: It has no joint to move along, or it would overlap an obstacle.
        """
        index = self._id(body)
        now, old = self._now(), self._motion()
        tree = [self._id(name) for name in self.with_children(body)]
        sensors, qpos = self._sensors(), now.qpos.copy()
        before = clearance.depths(sensors, qpos, tree)
        target = self._readout.on_grid(target)
        motion.place(self._model, now, qpos, index, target)
        for pair, depth in clearance.depths(sensors, qpos, tree).items():
            mine, other = (self._model.body(index).name for index in pair)
            # Hidden bodies that move along are not checked: a refusal would reveal them. Neither are soft bodies.
            if mine in obstacles and other in obstacles and depth > max(OVERLAP_LIMIT, before.get(pair, 0.0)):
                raise _overlap(obstacles[other])
        self._live().qpos[:] = qpos
        self._keep()
        self._disturb(old)
        return np.allclose(self._now().xpos[index], target, rtol=0, atol=1e-9)

    def shift(self, body: str, shift: Array, obstacles: Mapping[str, str]) -> bool:
        """Like `place`, with a target at a displacement (3,) [m] from the body's measured position.

        A displacement from the true position would reveal this position, because the target is rounded to a grid.
        """
        return self.place(body, self.pose(body).position + shift, obstacles)

    def set_velocity(self, body: str, velocity: Array) -> None:
        """Give the centre of mass a velocity [m/s], as near as the body's joints allow.

        Raises:
            NotPossible: No joint of the body can move its centre of mass.
        """
        rates = motion.velocity_rates(self._model, self._now(), self._id(body), velocity)
        self._set_rates(rates)

    def bounce(self, first: str, second: str) -> float:
        """Apply the perfectly elastic impulse along the normal of the contact of two bodies, and return it [N·s].

        The returned impulse is a reading: it is proportional to the measured closing speed.

        Raises:
            NotPossible: They do not touch, or neither body can move along the normal.
        """
        now, ids = self._now(), (self._id(first), self._id(second))
        true, read = readings.contact(self._model, now, *ids), self.contact(first, second)
        if true is None or read is None:
            raise NotPossible("they do not touch")
        row = readings.normal_row(self._model, now, true.point, true.normal, *ids)
        rates, impulse = motion.elastic_rates(self._model, now, row)
        self._set_rates(rates)
        return impulse * read.approach_speed / true.approach_speed if true.approach_speed else impulse

    def _set_rates(self, rates: Array) -> None:
        old = self._motion()
        self._live().qvel[:] = rates
        self._keep()
        self._disturb(old)

    # Editing

    def add_ball(
        self, body: str, position: Array, density: float, radius: float, rgba: Array, obstacles: Mapping[str, str]
    ) -> None:
        """Add a free sphere, at a position rounded to the resolution of positions; everything else keeps its state.

        Raises:
            NotPossible: It would overlap an obstacle by more than 1 mm, or its inertia is too small for the engine.
        """
        saved = self.save()
        if 0.4 * (4 / 3 * np.pi * radius**3 * density) * radius**2 < mujoco.mjMINVAL:
            raise NotPossible("so light a sphere cannot be simulated; give it a larger density or radius")
        position = self._readout.on_grid(position)
        self._replace(editing.with_ball(self._spec, body, position, density, radius, rgba))
        for (_, other), depth in clearance.depths(self._sensors(), self._now().qpos, [self._id(body)]).items():
            name = self._model.body(other).name
            if name in obstacles and depth > OVERLAP_LIMIT:
                self.restore(saved)
                raise _overlap(obstacles[name])
        self._disturbed |= {body}

    def remove(self, body: str) -> None:
        """Remove the body, the bodies jointed to it, and every constraint that refers to one of them."""
        self._replace(editing.without_body(self._spec, body))

    def join(self, first: str, second: str, kind: JointKind, axis: Array | None = None) -> None:
        """Constrain two bodies at their present relative pose; see `editing.with_joint`."""
        self._replace(editing.with_joint(self._spec, self._now(), (first, second), kind, axis))

    def reveal(self, body: str) -> None:
        """Draw the body's geoms in images from now on, even if they are transparent."""
        self._revealed |= {body}


def _overlap(label: str) -> NotPossible:
    # Do not report the depth: it would reveal withheld sizes and positions.
    return NotPossible(f"there it would overlap {label} by more than {1000 * OVERLAP_LIMIT:g} mm")
