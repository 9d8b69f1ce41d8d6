"""Systematic errors of the instruments for position and angle, which a model contains in a text element.

All bodies are read with the same error, as by a camera whose mount is displaced and creeps. Everything that uses
readings of positions (pictures, refusals to place a body, displacements) is affected by the error.
"""

import json
from collections.abc import Mapping
from typing import Any, Final, Literal, NamedTuple, cast, get_args

import mujoco
import numpy as np

from physment_mcp.errors import SceneError
from physment_mcp.world.readings import Array

TEXT: Final = "systematic_errors"
"""Name of the text element: JSON such as `{"position": {"bias": [0.1, 0, 0], "drift": [0.01, 0, 0]}}`."""
Systematic = Literal["position", "angle"]


class SystematicError(NamedTuple):
    """An error of an instrument that changes uniformly and is the same for all bodies."""

    bias: Array
    """Error (3,) at time 0 along the world axes, in the unit of the quantity."""
    drift: Array
    """Change (3,) of the error per second."""

    def at(self, time: float) -> Array:
        """The error (3,) at a simulated time [s]."""
        return self.bias + time * self.drift


def read_errors(spec: mujoco.MjSpec) -> dict[Systematic, SystematicError]:
    """The systematic errors in a model's text element; none if it has no such element.

    Raises:
        SceneError: The text is not in the format.
    """
    texts = [text.data for text in spec.texts if text.name == TEXT]
    if not texts:
        return {}
    try:
        listed = cast("Mapping[str, Any]", json.loads(texts[0]))
        found = {
            name: SystematicError(*(_vector(one[part]) for part in ("bias", "drift"))) for name, one in listed.items()
        }
    except (ValueError, TypeError, KeyError, AttributeError) as error:
        raise SceneError("the scene's systematic errors are not in the format") from error
    if not found.keys() <= set(get_args(Systematic)):
        raise SceneError("systematic errors can be those of position and angle only")
    return cast("dict[Systematic, SystematicError]", found)


def _vector(numbers: Any) -> Array:
    found = np.array(numbers, float)
    if found.shape != (3,) or not np.isfinite(found).all():
        raise ValueError(numbers)
    return found
