"""What the instruments of a world show of one state: true readings with noise, rounded. Changes nothing.

Everything that is shown of a body at one moment has the same noise: its position, its centre of mass and what tools
derive from them share three numbers, and so do its orientation and its joint angle, its spin and its joint speed.
Otherwise the mean of two readings of one quantity would have less noise than the scene states.
"""

from typing import NamedTuple

import mujoco
import numpy as np

from physment_mcp.world import readings
from physment_mcp.world.readings import Array, Contact, HingeMotion, Pose, Twist
from physment_mcp.world.readout import Quantity, Readout


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
            self.readout.rounded("position", true.position + self._noise("position", body)),
            self.readout.read_quaternion(true.quaternion, self._noise("angle", body)),
        )

    def centre(self, body: str) -> Array:
        """Centre of mass (3,) [m], world coordinates. Source: MuJoCo `xipos`."""
        return self.readout.rounded("position", self.data.xipos[self._id(body)] + self._noise("position", body))

    def twist(self, body: str) -> Twist:
        """Spin, and velocity of the centre of mass, world axes."""
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
        angle = self.readout.rounded("angle", true.angle + self._joint_noise("angle", body))
        spin = self.readout.rounded("spin", true.spin + self._joint_noise("spin", body))
        return HingeMotion(float(angle[0]), float(spin[0]))

    def contact(self, first: str, second: str) -> Contact | None:
        """The contact between two bodies, or None; with the bodies swapped, only the normal points the other way.

        It is read with the noise of both bodies and with noise of its own, so it tells no more of either body than the
        readings of that body do.
        """
        true = readings.contact(self.model, self.data, self._id(first), self._id(second))
        if true is None:
            return None
        tilt = self._pair_noise("angle", first, second)
        closing = self._noise("velocity", first) - self._noise("velocity", second)
        speed_noise = closing @ true.normal + self.readout.noise("velocity", _pair(first, second), self.step, 1)
        return Contact(
            self.readout.rounded("position", true.point + self._pair_noise("position", first, second)),
            self.readout.read_direction(true.normal, np.cross(tilt, true.normal)),
            float(self.readout.rounded("velocity", true.approach_speed + speed_noise)[0]),
        )

    def _id(self, body: str) -> int:
        return int(self.model.body(body).id)

    def _noise(self, quantity: Quantity, body: str) -> Array:
        """Noise (3,) in all readings of a vector of a body at this step."""
        noise = self.readout.noise(quantity, body, self.step, 3)
        if quantity in {"angle", "spin"} and self.readout.is_noisy(quantity):
            axis = readings.hinge_axis(self.model, self.data, self._id(body))
            if axis is not None:
                noise = noise + (self._joint_noise(quantity, body) - noise @ axis) * axis
        return noise

    def _joint_noise(self, quantity: Quantity, body: str) -> Array:
        """Noise (1,) of a body's turn about its hinge."""
        return self.readout.noise(quantity, f"{body}:joint", self.step, 1)

    def _pair_noise(self, quantity: Quantity, first: str, second: str) -> Array:
        """Noise (3,) of a vector of a contact."""
        own = self.readout.noise(quantity, _pair(first, second), self.step, 3)
        return own + (self._noise(quantity, first) + self._noise(quantity, second))


def _pair(first: str, second: str) -> str:
    """The source of a contact's own noise, whichever of the two bodies is named first."""
    return ":".join(sorted((first, second)))
