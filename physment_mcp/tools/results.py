"""Result models of the tools: no extra fields, finite numbers, a unit and a frame for every field."""

from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field

Vector = Annotated[list[float], Field(min_length=3, max_length=3)]
Quaternion = Annotated[list[float], Field(min_length=4, max_length=4)]


class Result(BaseModel):
    """Base of all results."""

    # Validators are built at their first use: an episode uses a few of the 26 tools, so it starts sooner.
    model_config = ConfigDict(
        extra="forbid", allow_inf_nan=False, json_schema_serialization_defaults_required=True, defer_build=True
    )

    sim_time: Annotated[float, Field(description="Simulation clock after the call [s].")]


class Components(BaseModel):
    """A vector by components, world frame."""

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False, defer_build=True)

    x: float
    y: float
    z: float


class Stepped(Result):
    """Result of `step`."""

    steps: Annotated[int, Field(description="Time steps run.")]
    lab_time_left: Annotated[float, Field(description="Simulated time that the episode may still use [s].")]
    calls_left: Annotated[
        int | None, Field(description="Calls that this laboratory still allows besides answer; null for no limit.")
    ]
    results: Annotated[None, Field(description="Always null: read what you need with the other tools.")] = None


class Position(Result):
    """Result of `get_position`."""

    position: Annotated[Vector, Field(description="Origin of the object's frame, world [m].")]
    orientation: Annotated[
        Quaternion | None, Field(description="Unit quaternion [w, x, y, z], object to world; null if withheld.")
    ]
    angle: Annotated[
        float | None,
        Field(description="Joint angle of an object on a hinge [rad], whole turns counted; null if not shown."),
    ]


class Moved(Result):
    """Result of `move_object`."""

    position: Annotated[Vector, Field(description="Where the object is now, world [m].")]
    note: Annotated[str | None, Field(description="Said if its joints did not allow the whole move.")] = None


class Shifted(Result):
    """Result of `change_position`."""

    new_position: Annotated[Vector, Field(description="Where the object is now, world [m].")]
    note: Annotated[str | None, Field(description="Said if its joints did not allow the whole move.")] = None


class Velocity(Result):
    """Result of `get_velocity`."""

    velocity: Annotated[Vector, Field(description="Velocity of the centre of mass, world [m/s].")]
    angular_velocity: Annotated[
        float | None, Field(description="Joint speed of an object on a hinge [rad/s]; null if not shown.")
    ]


class VelocitySet(Result):
    """Result of `set_velocity`."""

    status: str
    object_id: str
    velocity: Annotated[
        Vector | None,
        Field(description="Velocity of the centre of mass really obtained, world [m/s]; null if withheld."),
    ]


class Acceleration(Result):
    """Result of `get_acceleration`."""

    x: Annotated[float, Field(description="[m/s²], world frame.")]
    y: Annotated[float, Field(description="[m/s²], world frame.")]
    z: Annotated[float, Field(description="[m/s²], world frame.")]


class ForceSet(Result):
    """Result of `apply_force`."""

    status: str
    object_id: str
    force: Annotated[Vector, Field(description="External force at the centre of mass from now on, world [N].")]


class TorqueSet(Result):
    """Result of `apply_torque`."""

    status: str
    object_id: str
    torque: Annotated[Vector, Field(description="External torque from now on, world [N·m].")]


class Torque(Result):
    """Result of `get_torque`."""

    torque: Annotated[Components, Field(description="External torque set now, world [N·m].")]


class Parameters(Result):
    """Result of `get_parameters`."""

    mass: Annotated[float | None, Field(description="[kg]; null if withheld.")]
    bounding_box: Annotated[
        Vector | None,
        Field(description="Full edge lengths in the object's own frame [m]; null if withheld or endless."),
    ]
    type: Annotated[
        str | None, Field(description="sphere, box, cylinder, …, compound for several shapes; null if withheld.")
    ]
    withheld: Annotated[list[str], Field(description="Names of the fields this scene withholds.")]


class Displacement(Result):
    """Result of `get_displacement`."""

    displacement: Annotated[float, Field(description="Straight distance from where the object started [m].")]


class Force(Result):
    """Result of `compute_force`."""

    x: Annotated[float, Field(description="[N], world frame.")]
    y: Annotated[float, Field(description="[N], world frame.")]
    z: Annotated[float, Field(description="[N], world frame.")]


class KineticEnergy(Result):
    """Result of `get_kinetic_energy`."""

    kinetic_energy: Annotated[float, Field(description="Translational kinetic energy [J].")]


class PotentialEnergy(Result):
    """Result of `get_potential_energy`."""

    potential_energy: Annotated[float, Field(description="m g z of the centre of mass, zero at z = 0 [J].")]


class RotationalEnergy(Result):
    """Result of `get_rotational_energy`."""

    rotational_energy: Annotated[float, Field(description="Kinetic energy of the spin about the centre of mass [J].")]


class Momentum(Result):
    """Result of `get_momentum`."""

    momentum: Annotated[Components, Field(description="Linear momentum, world [kg·m/s].")]


class AngularMomentum(Result):
    """Result of `get_angular_momentum`."""

    angular_momentum: Annotated[
        Components, Field(description="Angular momentum about the centre of mass, world [kg·m²/s].")
    ]


class CenterOfMass(Result):
    """Result of `get_center_of_mass`."""

    center_of_mass: Annotated[Components, Field(description="Of the included objects together, world [m].")]
    included: Annotated[list[str], Field(description="Objects that were counted.")]
    excluded: Annotated[
        list[str], Field(description="Movable objects left out because their mass or position is withheld.")
    ]


class Collision(Result):
    """Result of `detect_collision`."""

    collision_detected: Annotated[bool, Field(description="Whether the two objects touch now.")]
    contact_point: Annotated[Vector | None, Field(description="Mean contact point, world [m]; null if withheld.")]
    normal: Annotated[
        Vector | None, Field(description="Unit normal from the first to the second, world; null if withheld.")
    ]
    approach_speed: Annotated[
        float | None,
        Field(description="Closing speed along the normal before any response [m/s]; null if withheld."),
    ]
    impulse: Annotated[
        float | None, Field(description="Elastic impulse applied [N·s]; 0 if none was due, null if only looking.")
    ]


class Rotation(Result):
    """Result of `quat_to_rot_matrix`."""

    rotation_matrix: Annotated[
        list[Vector], Field(min_length=3, max_length=3, description="Rows of the rotation matrix, object to world.")
    ]


class Created(Result):
    """Result of `create_objects`."""

    status: str
    name: str
    object_id: str
    position: Annotated[Vector, Field(description="Centre of the sphere, world [m].")]
    density: Annotated[float, Field(description="[kg/m³].")]
    rgba: Annotated[list[float], Field(min_length=4, max_length=4)]


class Deleted(Result):
    """Result of `delete_objects`."""

    status: str
    object_id: str
    also_deleted: Annotated[list[str], Field(description="Objects that were jointed to it and went with it.")]


class Found(Result):
    """Result of `find_objects`."""

    status: str
    revealed: Annotated[
        list[dict[str, Any]],
        Field(
            description="Objects that were hidden: object_id, name, and type, density [kg/m³], mass [kg], size (full"
            " edge lengths) [m], radius [m], position [m], orientation [w, x, y, z]; null where withheld."
        ),
    ]


class Attached(Result):
    """Result of `attach_objects`."""

    status: str
    joint: str


class Answered(Result):
    """Result of `answer`."""

    acknowledged: Annotated[bool, Field(description="The answer was taken down. Nothing is said about it.")]
