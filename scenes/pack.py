"""The format of `scene{N}.json`, for packs of the suite and of the published prototype.

Unknown keys are ignored, because other people write packs. `scenes.public` decides which fields the laboratory may see.
"""

from enum import StrEnum
from typing import Annotated, Literal, Self

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, model_validator

from scenes.answer_spec import AnswerSpec, Scalar
from scenes.laboratory import Instruments, LabLimits

CANARY = "physment-canary-4c0e6d1e-7a55-4d0e-9d0b-5f3c1c2a9b47"
"""Text in every private half, by which training corpora can exclude packs and leak tests can find them."""


class Rung(StrEnum):
    """Difficulty of a scene; the rungs are listed from the easiest to the hardest."""

    EASY = "easy"
    HARD = "hard"
    OPEN = "open"


class Category(StrEnum):
    """The 13 categories of the suite (difficulty, breadth, modality), and the separate track of open worlds."""

    EASY_SINGLE = "easy-single"
    EASY_SINGLE_CREATION = "easy-single-creation"
    EASY_SINGLE_HIDDEN = "easy-single-hidden"
    HARD_SINGLE = "hard-single"
    HARD_SINGLE_CREATION = "hard-single-creation"
    HARD_SINGLE_HIDDEN = "hard-single-hidden"
    EASY_MULTI = "easy-multi"
    EASY_MULTI_CREATION = "easy-multi-creation"
    EASY_MULTI_HIDDEN = "easy-multi-hidden"
    HARD_MULTI = "hard-multi"
    HARD_MULTI_CREATION = "hard-multi-creation"
    HARD_MULTI_HIDDEN = "hard-multi-hidden"
    CREATE_DELETE_ATTACH = "create-delete-attach"
    OPEN = "open"

    @property
    def rung(self) -> Rung:
        """Rung of the category; create-delete-attach is hard."""
        if self is Category.OPEN:
            return Rung.OPEN
        return Rung.HARD if self.infers else Rung.EASY

    @property
    def infers(self) -> bool:
        """Whether scenes of the category ask for a prediction from an inferred law, not for a measurement."""
        return self.value.startswith("hard") or self in {Category.CREATE_DELETE_ATTACH, Category.OPEN}


class _PackModel(BaseModel):
    model_config = ConfigDict(extra="ignore", frozen=True, use_attribute_docstrings=True)


class Metadata(_PackModel):
    """Name, task, type and description of the scene."""

    scene_name: str
    """Name of the scene, which must not hint at the answer."""
    task: str = Field(min_length=1)
    """Description of the laboratory, and the question with its unit and sign convention."""
    problem_type: str
    """`comparison`, `calculation`, `computation` or `observation`; published packs use others too."""
    description: str = ""
    """One line for readers of the pack. Private."""


class SceneObject(_PackModel):
    """An object that the task names."""

    name: str
    """Neutral name, such as block or post."""
    object_id: Annotated[str, BeforeValidator(str)]
    """Number of the object; its body in the MJCF is `object_{number}`."""


_ATTRIBUTES = {
    "geom_type": "shape",
    "geom_size": "size",
    "geom_radius": "radius",
    "geom_density": "density",
    "body_mass": "mass",
    "body_pos": "position",
    "body_quat": "orientation",
    "angle": "angle",
    "velocity": "velocity",
    "spin": "spin",
}
"""Permission → name of the attribute that it allows to read."""


class Permissions(_PackModel):
    """The attributes of an object that the agent may read or change. An omitted static attribute is withheld."""

    geom_type: bool = False
    """Shape."""
    geom_density: bool = False
    """Density, which determines the mass together with the size."""
    body_mass: bool = False
    """Mass."""
    geom_size: bool = False
    """Edge lengths."""
    geom_radius: bool = False
    """Radius."""
    body_pos: bool = False
    """Position, displacement and contact points. An object can be moved only if its position may be read."""
    body_quat: bool = False
    """Orientation and contact normals of flat faces."""
    velocity: bool = True
    """Velocity, acceleration, energies, momenta and approach speed."""
    actuate: bool = True
    """If false, the object is read-only: it cannot be pushed, moved, attached or deleted."""
    hidden: bool = False
    """Whether the object is unknown to the agent until `find_objects` is called."""
    angle: bool = False
    """Whether the position of an object on a hinge includes its joint angle."""
    spin: bool | None = None
    """Whether the velocity of an object on a hinge includes its joint speed. If false, rotational energy and angular
    momentum, for which `velocity` otherwise decides, are withheld too."""

    @property
    def readable(self) -> tuple[str, ...]:
        """Names of the attributes that the agent may read, in words."""
        return tuple(word for field, word in _ATTRIBUTES.items() if getattr(self, field) is True)


class Knob(_PackModel):
    """A hidden quantity: how it is drawn for seeds other than 0, and its value at seed 0.

    Exactly one of `uniform`, `log_uniform`, `choice` and `permutation` is given.
    """

    canonical: Scalar | tuple[Scalar, ...]
    """Value at seed 0, as written in the XML."""
    uniform: tuple[float, float] | None = None
    """Bounds of a uniform distribution."""
    log_uniform: tuple[float, float] | None = None
    """Bounds of a log-uniform distribution."""
    choice: tuple[Scalar, ...] | None = None
    """Values of which one is drawn."""
    permutation: tuple[Scalar, ...] | None = None
    """Values that are shuffled."""
    meaning: str = ""
    """Description of the quantity with its unit, for readers of the pack."""

    @model_validator(mode="after")
    def _one_way_to_draw(self) -> Self:
        ways = ("uniform", "log_uniform", "choice", "permutation")
        given = [way for way in ways if getattr(self, way) is not None]
        if len(given) != 1:
            msg = f"give exactly one of {', '.join(ways)}; found {', '.join(given) or 'none'}"
            raise ValueError(msg)
        for bounds in (self.uniform, self.log_uniform):
            if bounds is not None and not bounds[0] < bounds[1]:
                msg = f"the range {list(bounds)} is empty: the first bound must be below the second"
                raise ValueError(msg)
        if self.log_uniform is not None and self.log_uniform[0] <= 0:
            msg = "log_uniform needs bounds above 0"
            raise ValueError(msg)
        return self


Expression = str | int | float
"""Arithmetic over knob values, such as `9.81 * m` or `order[0]`, or a plain number."""


class IntermediateQuantity(_PackModel):
    """An intermediate quantity, which an agent may state together with its answer."""

    meaning: str = Field(min_length=1)
    """Description of the quantity. Public: it must not say how the answer follows."""
    unit: str
    """Unit; `1` for a pure number. Public."""
    value: Expression
    """Expression of the value from the knobs. Private."""


class Law(_PackModel):
    """A force on a body, by expressions that the engine evaluates at every stage of every time step.

    Expressions may use the time `t` [s]; the centre of mass `x`, `y`, `z` [m] of the body, its velocity `vx`, `vy`,
    `vz` [m/s] and its spin `wx`, `wy`, `wz` [rad/s], all in world axes; for a body on a single hinge `angle` [rad] and
    `spin` [rad/s]; for another body the same names with its prefix, such as `other_x`; numeric knobs and derived
    quantities.
    """

    model_config = ConfigDict(extra="forbid")

    on: str
    """Name of the body on which the law acts, at its centre of mass."""
    others: dict[str, str] = Field(default={}, alias="with")
    """Prefix → name of another body that the expressions use."""
    let: dict[str, str] = {}
    """Auxiliary quantities, which are computed first, in order."""
    force: tuple[Expression, Expression, Expression] = (0, 0, 0)
    """Components of the force, world frame [N]."""
    torque: tuple[Expression, Expression, Expression] = (0, 0, 0)
    """Components of the torque, world frame [N·m]."""
    reaction: str | None = None
    """Prefix of the body on whose centre of mass the opposite force acts; None for no reaction."""
    present: Expression = 1
    """Condition on the knobs. If it is false, the law stays in the model with factor 0, so that a step takes the same
    time at every seed. Its values must therefore be finite there too."""

    @model_validator(mode="after")
    def _forces_alone_have_a_reaction(self) -> Self:
        if self.reaction is not None and self.torque != (0, 0, 0):
            msg = "`reaction` belongs to a force and not to a torque: write the torque as a law of its own"
            raise ValueError(msg)
        return self


class Catch(_PackModel):
    """A part of the apparatus that limits motion: a latch, net, rim, guard or stop.

    Certificate 11 applies the largest allowed loads and checks that the catch holds. Expressions are those of laws,
    over the true state: `object_1_x`, `object_1_vx`, `object_1_angle` and so on for any body, the same names with the
    prefix `caught_` for the value at which the catch acted, the time `t` [s], and numeric knobs.
    """

    model_config = ConfigDict(extra="forbid")

    words: tuple[str, ...] = Field(min_length=1)
    """Words of the prompt that denote the catch."""
    sprung: str | None = None
    """Condition that is true once the catch has acted; None if it limits the motion at all times."""
    holds: dict[str, tuple[Expression, Expression]] = Field(min_length=1)
    """Expression → bounds between which it must stay after the catch has acted."""
    within: float = Field(default=0.0, ge=0)
    """Time that the catch may take to act [s]."""


class SchematicPart(_PackModel):
    """A cord, spring, rod, rail or pulley in the task that has no body in the model, for drawings.

    It is public and the same at every seed: it refers only to visible listed objects and fixed positions.
    """

    model_config = ConfigDict(extra="forbid")

    kind: Literal["cord", "spring", "rod", "rail", "pulley"]
    """Kind of the part, which determines how it is drawn."""
    points: tuple[str | tuple[float, float, float], ...] = Field(min_length=1)
    """Polyline of the part: ids such as `object_1` for the centre of an object, or positions in the world [m]. A pulley
    has one point."""

    @model_validator(mode="after")
    def _course_has_ends(self) -> Self:
        if (self.kind == "pulley") != (len(self.points) == 1):
            msg = f"a {self.kind} has {'one point' if self.kind == 'pulley' else 'two points or more'}"
            raise ValueError(msg)
        return self


class Pack(_PackModel):
    """A complete `scene{N}.json`, with its public and private halves."""

    metadata: Metadata
    """Name, task, type and description of the scene. The agent reads all but the description."""
    answer: Scalar | tuple[Scalar, ...]
    """The key at seed 0. Private."""
    expected_behavior: str = ""
    """Description of a good experiment. Private."""
    reasoning: str = ""
    """Derivation of the answer. Private."""
    number_of_objects: Annotated[
        int, BeforeValidator(lambda value: int(value) if isinstance(value, str) else value)
    ] = 0
    """Number of listed objects; published packs write it as a string."""
    objects: dict[str, SceneObject]
    """`object_1`, `object_2`, … → the objects, hidden ones included."""
    object_permissions: dict[str, Permissions] = {}
    """`object_1_permissions`, … → what an agent may read and do. Omitted permissions are withheld."""

    category: Category | None = None
    """One of the 13 categories; published packs have none."""
    concepts: tuple[str, ...] = ()
    """The physical concepts: one in `single` scenes, two or more otherwise."""
    answer_spec: AnswerSpec | None = None
    """Type, unit and tolerance of the answer; published packs have none."""
    steps: dict[str, IntermediateQuantity] = {}
    """Intermediate quantities by name, which agents may state and which are graded separately from the answer."""
    disabled_tools: dict[str, str] = {}
    """Tool name → reason for disabling it, which only readers of the pack see."""
    requires: tuple[str, ...] = ()
    """Tools without which the scene cannot be solved."""
    soft_objects: tuple[str, ...] = ()
    """Ids of objects with soft surfaces, for which an overlap of more than 1 mm is allowed."""
    knobs: dict[str, Knob] = {}
    """The hidden quantities, by name."""
    derive: dict[str, Expression] = {}
    """Quantities computed from the knobs, in order; usable in `apply`, `accept_draw`, `theory` and `measure`."""
    accept_draw: tuple[str, ...] = ()
    """Conditions on a draw, such as `abs(mu - tan(0.5)) > 0.02`; a draw that violates one is repeated."""
    apply: dict[str, Expression | tuple[Expression, ...]] = {}
    """Targets of values in the MJCF: `tag[name].attribute` → expression, or a list for a vector attribute. A path such
    as `body[object_1]/inertial.mass` or `fixed[cord]/joint[wheel].coef` identifies an element by its parent."""
    laws: tuple[Law, ...] = ()
    """Forces that no MuJoCo element provides. Private."""
    catches: tuple[Catch, ...] = ()
    """Latches, nets, rims, guards and stops of the prompt. Private."""
    family: dict[str, str] = {}
    """Kinds of laws by name, each with the words by which the task states it. Private."""
    schematic: tuple[SchematicPart, ...] = ()
    """Additional elements of drawings. Not part of the certified content."""
    limits: LabLimits | None = None
    """Limits of an episode, stated in the prompt. Published packs have none."""
    instruments: Instruments | None = None
    """Resolutions of the instruments, stated in the prompt. Published packs have none."""
    version: str = "1"
    """Version of the pack, incremented when its meaning changes."""
    canary: str | None = None
    """The canary string, by which training corpora can exclude packs."""
    format: Literal[1] = 1
    """Version of this format."""

    @property
    def predicts(self) -> bool:
        """Whether the pack asks for a prediction and sets limits, so that certificates 7 to 10 and 12 apply."""
        return self.category is not None and self.category.infers and self.limits is not None

    @property
    def law_answer(self) -> bool:
        """Whether an agent may state a law with its answer. This follows from the category, not from a field."""
        return self.category is Category.OPEN

    def permissions_of(self, key: str) -> Permissions:
        """Permissions of the object listed under `key` (such as `object_1`); by default all are withheld."""
        return self.object_permissions.get(f"{key}_permissions", Permissions())
