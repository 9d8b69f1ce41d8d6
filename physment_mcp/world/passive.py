"""Applies laws through the engine's callback for passive forces, and maps models to their laws.

The engine has one such callback per process. It is installed as a C function, only while a model with laws exists, and
receives addresses. A Python function would be unsafe. While it is installed, MuJoCo cannot compile any model, because
compiling steps a model that has no Python object. Removing it breaks a step in another thread.
"""

import ctypes
import threading
import weakref

import mujoco
import numpy as np

from physment_mcp.world.laws import BoundLaws
from physment_mcp.world.reentrant import Addresses

_LAWS: dict[int, BoundLaws] = {}
"""Address of a model → its laws."""

_DATA: weakref.WeakValueDictionary[int, mujoco.MjData] = weakref.WeakValueDictionary()
"""Address → data of models with laws."""

_LOCK = threading.RLock()  # reentrant, because the garbage collector may free a model while the lock is held


@ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p)
def _add_laws(model_address: int, data_address: int) -> None:
    """Add the forces of laws to `qfrc_passive`; NaN if a law has no value, so that the step is detected as unstable."""
    laws = _LAWS.get(model_address)
    if laws is None:
        return
    data, at = _DATA[data_address], Addresses(model_address, data_address)
    acted = False
    try:
        laws.act(at, data)
        acted = True
    except (ArithmeticError, ValueError):
        return
    finally:
        # Also after a KeyboardInterrupt: exceptions do not propagate through the engine, and no force may be lost.
        if not acted:
            data.qfrc_passive[:] = np.nan


def let_act(model: mujoco.MjModel, laws: BoundLaws | None) -> None:
    """Apply laws to a model during its lifetime, for all data created by `data_of`. Does nothing without laws."""
    if laws is None:
        return
    with _LOCK:
        _LAWS[model._address] = laws  # noqa: SLF001 - what the engine gives to the callback
        weakref.finalize(model, _forget, model._address, laws)  # noqa: SLF001 - as above
        mujoco.set_mjcb_passive(_add_laws)


def data_of(model: mujoco.MjModel) -> mujoco.MjData:
    """Create data for a model, on which its laws act."""
    data = mujoco.MjData(model)
    if model._address in _LAWS:  # noqa: SLF001 - as above
        _DATA[data._address] = data  # noqa: SLF001 - as above
    return data


def _forget(address: int, laws: BoundLaws) -> None:
    """Remove the laws of a freed model; if no laws remain, also remove the engine's callback."""
    with _LOCK:
        # A new model may already have the same address.
        if _LAWS.get(address) is laws:
            del _LAWS[address]
        if not _LAWS:
            mujoco.set_mjcb_passive(None)
