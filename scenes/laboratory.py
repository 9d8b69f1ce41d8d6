"""The public fields of a pack about its laboratory: the limits of an episode, and the instruments."""

from typing import Any

from pydantic import BaseModel, ConfigDict, Field


class _LaboratoryModel(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, use_attribute_docstrings=True)


class LabLimits(_LaboratoryModel):
    """Limits on an agent in one episode. Omitted fields have the default limits of every laboratory."""

    force: float | None = Field(default=None, ge=0)
    """Largest magnitude of the force on an object [N]; 0 if no force can be applied."""
    torque: float | None = Field(default=None, ge=0)
    """Largest magnitude of the torque on an object [N·m]; 0 if no torque can be applied."""
    created_mass: float | None = Field(default=None, gt=0)
    """Largest total mass of all objects created in the episode, deleted ones included [kg]."""
    lab_time: float | None = Field(default=None, gt=0)
    """Largest simulated time [s]."""
    calls: int | None = Field(default=None, gt=0)
    """Largest number of tool calls, refused ones included. `answer` is neither counted nor refused."""


class Noise(_LaboratoryModel):
    """Standard deviations of the Gaussian noise of the instruments."""

    position: float = Field(default=0.0, ge=0)
    """Noise of each coordinate of a position [m]."""
    velocity: float = Field(default=0.0, ge=0)
    """Noise of each component of a velocity [m/s]."""
    angle: float = Field(default=0.0, ge=0)
    """Noise of an angle [rad]."""
    spin: float = Field(default=0.0, ge=0)
    """Noise of each component of a spin [rad/s]."""


class SystematicBounds(_LaboratoryModel):
    """Bounds of the systematic errors of positions. The model of the scene contains the errors themselves."""

    position: float = Field(default=0.0, ge=0)
    """Bound of each coordinate of a position [m, or m/s for a drift]."""
    angle: float = Field(default=0.0, ge=0)
    """Bound of an angle [rad, or rad/s for a drift]."""


def _is_none(value: Any) -> bool:
    return value is None


class Instruments(_LaboratoryModel):
    """Resolution of each instrument; 0 for full precision."""

    position: float = Field(default=0.0, ge=0)
    """Resolution of each coordinate of a position [m]."""
    velocity: float = Field(default=0.0, ge=0)
    """Resolution of each component of a velocity [m/s]."""
    angle: float = Field(default=0.0, ge=0)
    """Resolution of an angle [rad]."""
    spin: float = Field(default=0.0, ge=0)
    """Resolution of each component of a spin [rad/s]."""
    noise: Noise | None = None
    """Noise that is added before rounding; all readings of one quantity at one moment share it."""
    bias: SystematicBounds | None = Field(default=None, exclude_if=_is_none)
    """Largest systematic error of positions when the clock shows 0; it is the same for all objects."""
    drift: SystematicBounds | None = Field(default=None, exclude_if=_is_none)
    """Largest change of the systematic error of positions per second; the change is uniform."""
