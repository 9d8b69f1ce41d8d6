"""Measurement model of the instruments: resolution, seeded noise, systematic errors, and readings of one state.

Related readings of a body at one moment share their noise. Position, centre of mass and everything that tools derive
from them use the same three random numbers; so do orientation and joint angle, and spin and joint speed. Otherwise the
mean of two such readings would have less noise than the scene states.
"""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from statistics import NormalDist
from typing import Literal, NamedTuple, Self

import mujoco
import numpy as np

from physment_mcp.world import readings
from physment_mcp.world.readings import Array, Contact, HingeMotion, Pose, Twist
from physment_mcp.world.systematic import Systematic, SystematicError

Quantity = Literal["position", "velocity", "angle", "spin"]

_NORMAL = NormalDist()
_PER_UNIT = 1e12
"""Steps per unit to which a rounded reading is rounded once more, to remove floating-point error."""


@dataclass(frozen=True, slots=True)
class Fineness:
    """Resolution and noise of one quantity, in its unit."""

    resolution: float = 0.0
    """Step of the readings; 0 for full precision."""
    noise: float = 0.0
    """Standard deviation of the Gaussian noise in each component."""


@dataclass(frozen=True, slots=True)
class Readout:
    """Converts true values to readings. By default a reading is the true value.

    The noise is a deterministic function of seed, object, quantity, component and time step. Repeated readings at the
    same moment are therefore equal, and averaging reduces noise only over different moments.
    """

    fineness: Mapping[Quantity, Fineness] = field(default_factory=dict[Quantity, Fineness])
    seed: str = ""
    """Seed of the noise. It must not depend on hidden values."""
    admitted: frozenset[Systematic] = frozenset()
    """Quantities for which the prompt states a systematic error."""
    systematic: Mapping[Systematic, SystematicError] = field(default_factory=dict[Systematic, SystematicError])
    """Systematic error of each quantity that has one."""

    def salted(self, salt: str) -> Self:
        """Return a copy of this readout whose noise also depends on a secret salt."""
        return replace(self, seed=f"{self.seed}:{salt}")

    def with_errors(self, errors: Mapping[Systematic, SystematicError]) -> Self:
        """Return a copy of this readout with the systematic errors that the model contains and the prompt states."""
        return replace(self, systematic={name: error for name, error in errors.items() if name in self.admitted})

    def is_noisy(self, quantity: Quantity) -> bool:
        """Whether readings of a quantity have noise."""
        return quantity in self.fineness and self.fineness[quantity].noise > 0

    def noise(self, quantity: Quantity, source: str, step: int, count: int) -> Array:
        """Return the noise (count,) of a reading, in the unit of the quantity; zeros without noise.

        Args:
            quantity: The quantity that is read.
            source: Identifier of the measured object, such as a body name; selects the noise stream.
            step: Number of the time step.
            count: Number of components.
        """
        if not self.is_noisy(quantity):
            return np.zeros(count)
        return self.fineness[quantity].noise * self._standard_normal(quantity, source, step, count)

    def resolution(self, quantity: Quantity) -> float:
        """Resolution of a quantity, in its unit; 0 for full precision."""
        return self.fineness[quantity].resolution if quantity in self.fineness else 0.0

    def rounded(self, quantity: Quantity, value: Array) -> Array:
        """Round a value, to which noise has been added, to the resolution of its quantity."""
        resolution = self.resolution(quantity)
        return _rounded(value, resolution) if resolution > 0 else value

    def read_quaternion(self, true: Array, noise: Array) -> Array:
        """The reading of a unit quaternion (4,): its rotation vector is rounded as an angle, component by component.

        Args:
            true: The true orientation.
            noise: A rotation vector (3,), world axes, by which the reading is turned [rad].
        """
        if "angle" not in self.fineness and "angle" not in self.systematic:
            return true
        turned = true if not noise.any() else _product(quaternion_of(noise), true)
        return quaternion_of(self.rounded("angle", rotation_vector(turned)))

    def read_direction(self, true: Array, noise: Array) -> Array:
        """The reading of a unit vector (3,): each component with its noise is rounded as an angle."""
        if "angle" not in self.fineness:
            return true
        read = self.rounded("angle", true + noise)
        length = float(np.linalg.norm(read))
        return read / length if length > 0 else true

    def on_grid(self, place: Array) -> Array:
        """Round a target position to the resolution of positions.

        With unrounded targets, refusals to place an object would reveal positions more precisely than the instruments.
        """
        return self.rounded("position", place)

    def _standard_normal(self, quantity: Quantity, source: str, step: int, count: int) -> Array:
        """Standard normal numbers (count,), the same on every machine."""
        digest = hashlib.sha512(f"{self.seed}:{source}:{quantity}:{step}".encode()).digest()
        words = np.frombuffer(digest, dtype=">u8")[:count]
        # The shift by one half keeps the probability off 0 and 1.
        return np.array([_NORMAL.inv_cdf((int(word >> np.uint64(12)) + 0.5) / 2**52) for word in words])


def rotation_vector(quaternion: Array) -> Array:
    """The rotation vector (3,) of a unit quaternion (4,) [rad]."""
    sine = float(np.linalg.norm(quaternion[1:]))
    return np.zeros(3) if sine == 0 else 2 * np.arctan2(sine, quaternion[0]) * (quaternion[1:] / sine)


def quaternion_of(turn: Array) -> Array:
    """The unit quaternion (4,) of a rotation vector (3,) [rad]."""
    angle = float(np.linalg.norm(turn))
    # sin(angle/2)/angle by numpy's sinc, which is smooth at 0.
    return np.concatenate(([np.cos(angle / 2)], turn * np.sinc(angle / (2 * np.pi)) / 2))


def _product(first: Array, second: Array) -> Array:
    """Return the quaternion (4,) of the rotation by `second` followed by the one by `first`."""
    scalar = first[0] * second[0] - first[1:] @ second[1:]
    return np.concatenate(([scalar], first[0] * second[1:] + second[0] * first[1:] + np.cross(first[1:], second[1:])))


def _rounded(value: Array, resolution: float) -> Array:
    """The nearest multiples of a resolution."""
    # Equivalent to np.round, which takes three times as long for three numbers.
    return np.rint(np.rint(value / resolution) * resolution * _PER_UNIT) / _PER_UNIT


EXACT = Readout()
"""Readout without resolution and noise."""


class Sensors(NamedTuple):
    """The instruments of a world, at one settled state."""

    readout: Readout
    model: mujoco.MjModel
    data: mujoco.MjData
    step: int
    """Number of the time step, which sets the noise."""

    def pose(self, body: str) -> Pose:
        """Pose of the body frame, world coordinates."""
        true = readings.pose(self.model, self.data, self._id(body))
        return Pose(
            self.readout.rounded("position", true.position + self._error("position", body)),
            self.readout.read_quaternion(true.quaternion, self._error("angle", body)),
        )

    def centre(self, body: str) -> Array:
        """Centre of mass (3,) [m], world coordinates. Source: MuJoCo `xipos`."""
        return self.readout.rounded("position", self.data.xipos[self._id(body)] + self._error("position", body))

    def twist(self, body: str) -> Twist:
        """Angular velocity, and linear velocity of the centre of mass, both along the world axes."""
        true = readings.twist(self.model, self.data, self._id(body))
        return Twist(
            self.readout.rounded("spin", true.angular + self._noise("spin", body)),
            self.readout.rounded("velocity", true.linear + self._noise("velocity", body)),
        )

    def velocity(self, body: str) -> Array:
        """Velocity of the centre of mass (3,) [m/s], world axes."""
        true = readings.twist(self.model, self.data, self._id(body)).linear
        return self.readout.rounded("velocity", true + self._noise("velocity", body))

    def turn(self, body: str) -> HingeMotion | None:
        """Joint angle and joint speed of a body with exactly one hinge among its own joints; None for other bodies."""
        true = readings.turn(self.model, self.data, self._id(body))
        if true is None:
            return None
        error = self._joint_noise("angle", body)
        axis = readings.hinge_axis(self.model, self.data, self._id(body)) if self.readout.systematic else None
        if axis is not None:
            error = error + self._systematic("angle") @ axis
        angle = self.readout.rounded("angle", true.angle + error)
        spin = self.readout.rounded("spin", true.spin + self._joint_noise("spin", body))
        return HingeMotion(float(angle[0]), float(spin[0]))

    def contact(self, first: str, second: str) -> Contact | None:
        """The contact between two bodies, or None. Swapping the bodies only reverses the normal.

        The reading contains the noise of both bodies and separate noise of the contact, so it reveals no more about
        either body than that body's own readings.
        """
        true = readings.contact(self.model, self.data, self._id(first), self._id(second))
        if true is None:
            return None
        place = true.point + self._pair_noise("position", first, second)
        if self.readout.systematic:
            place = place + self._systematic("position")
        tilt = self._pair_noise("angle", first, second)
        closing = self._noise("velocity", first) - self._noise("velocity", second)
        speed_noise = closing @ true.normal + self.readout.noise("velocity", _pair(first, second), self.step, 1)
        return Contact(
            self.readout.rounded("position", place),
            self.readout.read_direction(true.normal, np.cross(tilt, true.normal)),
            float(self.readout.rounded("velocity", true.approach_speed + speed_noise)[0]),
        )

    def _id(self, body: str) -> int:
        return int(self.model.body(body).id)

    def _systematic(self, quantity: Systematic) -> Array:
        """Systematic error (3,) of a quantity at this step; zeros if it has none."""
        error = self.readout.systematic.get(quantity)
        return np.zeros(3) if error is None else error.at(self.step * float(self.model.opt.timestep))

    def _error(self, quantity: Systematic, body: str) -> Array:
        """Error (3,) of a body's position or orientation at this step: noise and systematic error."""
        noise = self._noise(quantity, body)
        return noise + self._systematic(quantity) if self.readout.systematic else noise

    def _noise(self, quantity: Quantity, body: str) -> Array:
        """Noise (3,) shared by all readings of a vector quantity of a body at this step."""
        noise = self.readout.noise(quantity, body, self.step, 3)
        if quantity in {"angle", "spin"} and self.readout.is_noisy(quantity):
            axis = readings.hinge_axis(self.model, self.data, self._id(body))
            if axis is not None:
                noise = noise + (self._joint_noise(quantity, body) - noise @ axis) * axis
        return noise

    def _joint_noise(self, quantity: Quantity, body: str) -> Array:
        """Noise (1,) of a body's rotation about its hinge at this step."""
        return self.readout.noise(quantity, f"{body}:joint", self.step, 1)

    def _pair_noise(self, quantity: Quantity, first: str, second: str) -> Array:
        """Noise (3,) of a vector quantity of a contact at this step."""
        own = self.readout.noise(quantity, _pair(first, second), self.step, 3)
        return own + (self._noise(quantity, first) + self._noise(quantity, second))


def _pair(first: str, second: str) -> str:
    """Noise source of a contact between two bodies, independent of their order."""
    return ":".join(sorted((first, second)))
