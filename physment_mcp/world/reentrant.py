"""Reentrant engine functions, which may be called from the callback for passive forces.

Each function of the Python package `mujoco` installs an error handler when it begins and removes it when it ends. A
nested call removes the handler of the outer call, and an engine error after that would abort the process. This module
calls the same C functions through ctypes, without the handler.
"""

import ctypes
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import NamedTuple, Self

import mujoco

_FILES = ("libmujoco.so*", "libmujoco*.dylib", "mujoco.dll")
"""File names of the engine's shared library on Linux, macOS and Windows."""
_BODY = int(mujoco.mjtObj.mjOBJ_BODY)
_POINTER, _INT = ctypes.c_void_p, ctypes.c_int
_Six = ctypes.c_double * 6
_THREE = 3 * ctypes.sizeof(ctypes.c_double)
"""Size of a vector of three doubles [bytes]."""
_numbers_of = (ctypes.c_double * 0).from_buffer
"""Returns the buffer of a numpy array, even of an empty one. Takes a third of the time of `array.ctypes`."""


def _library() -> ctypes.PyDLL:
    """The engine's shared library, which is already loaded. Its functions are short, so they hold the GIL."""
    folder = Path(mujoco.__file__).parent
    return ctypes.PyDLL(str(next(file for name in _FILES for file in sorted(folder.glob(name)))))


_ENGINE = _library()
_OBJECT_VELOCITY, _APPLY_FT = _ENGINE.mj_objectVelocity, _ENGINE.mj_applyFT
_OBJECT_VELOCITY.argtypes = (_POINTER, _POINTER, _INT, _INT, _POINTER, _INT)
_APPLY_FT.argtypes = (_POINTER, _POINTER, _POINTER, _POINTER, _POINTER, _INT, _POINTER)
_OBJECT_VELOCITY.restype = _APPLY_FT.restype = None


class Addresses(NamedTuple):
    """Addresses of a model and its data, as the engine passes them to a callback."""

    model: int
    data: int

    @classmethod
    def of(cls, model: mujoco.MjModel, data: mujoco.MjData) -> Self:
        """The addresses of a Python model object and its data."""
        return cls(model._address, data._address)  # noqa: SLF001 - what the engine gives to a callback


def body_velocity(at: Addresses, body: int) -> list[float]:
    """Motion of a body at its centre of mass, world axes: rotation first (6,) [rad/s, m/s].

    Source: MuJoCo `mj_objectVelocity`.
    """
    velocity = _Six()
    _OBJECT_VELOCITY(at.model, at.data, _BODY, body, velocity, 0)
    return velocity[:]


def add_passive_forces(at: Addresses, data: mujoco.MjData, loads: Sequence[float], bodies: Iterable[int]) -> None:
    """Add forces [N] at the centres of mass of bodies and torques [N·m], world axes, to the passive forces.

    Args:
        at: Addresses of the model and of `data`.
        data: Data of the model.
        loads: Six numbers, force and torque, for each of `bodies`.
        bodies: Ids of the bodies on which the loads act, in order; an id may occur more than once.

    Source: MuJoCo `mj_applyFT`, `qfrc_passive`.
    """
    model, address = at
    row, sums = (ctypes.c_double * len(loads))(*loads), _numbers_of(data.qfrc_passive)
    force, centres = ctypes.addressof(row), ctypes.addressof(_numbers_of(data.xipos))
    for body in bodies:
        _APPLY_FT(model, address, force, force + _THREE, centres + _THREE * body, body, sums)
        force += 2 * _THREE
