"""The public fields of a pack about its laboratory: the limits of an episode, and the instruments."""

from pydantic import BaseModel, ConfigDict, Field


class _LaboratoryModel(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, use_attribute_docstrings=True)


class LabLimits(_LaboratoryModel):
    """Limits of an agent in one episode. Omitted fields have the default limits of every laboratory."""

    force: float | None = Field(default=None, ge=0)
    """Largest magnitude of the force that can be applied to an object [N]; 0 if none can."""
    torque: float | None = Field(default=None, ge=0)
    """Largest magnitude of the torque that can be applied to an object [N·m]; 0 if none can."""
    created_mass: float | None = Field(default=None, gt=0)
    """Total mass of all objects created in the episode, deleted ones too [kg]."""
    lab_time: float | None = Field(default=None, gt=0)
    """Simulated time [s]."""
    calls: int | None = Field(default=None, gt=0)
    """Tool calls, refused ones too. `answer` is neither counted nor refused."""


class Noise(_LaboratoryModel):
    """Standard deviations of the Gaussian noise of the instruments."""

    position: float = Field(default=0.0, ge=0)
    """Of each coordinate of a position [m]."""
    velocity: float = Field(default=0.0, ge=0)
    """Of each component of a velocity [m/s]."""
    angle: float = Field(default=0.0, ge=0)
    """Of an angle [rad]."""
    spin: float = Field(default=0.0, ge=0)
    """Of each component of a spin [rad/s]."""


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
    """Noise that is added before the reading is rounded; all readings of one quantity at one moment have the same."""
