"""Lets laws act: the engine's callback for passive forces, and which laws belong to which model.

The engine has one such callback for the process. It is a C function, installed only while a model with laws lives, and
gets addresses. Neither would be safe with a Python function: MuJoCo fails to compile any model while one is installed,
because it steps a model without a Python object then; and removing one fails a step in another thread.
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
"""Address → data of a model with laws."""

_LOCK = threading.RLock()  # of one thread many times, because a model can be freed at any moment


@ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p)
def _add_laws(model_address: int, data_address: int) -> None:
    """Add the forces of laws to `qfrc_passive`; NaN if one has no value, so that the world finds its state unstable."""
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
        # Also if an interrupt ends the law: an exception does not pass through the engine, and no force may be lost.
        if not acted:
            data.qfrc_passive[:] = np.nan


def let_act(model: mujoco.MjModel, laws: BoundLaws | None) -> None:
    """Let laws act on a model for as long as it lives, if there are any, on all data that `data_of` makes for it."""
    if laws is None:
        return
    with _LOCK:
        _LAWS[model._address] = laws  # noqa: SLF001 - what the engine gives to the callback
        weakref.finalize(model, _forget, model._address, laws)  # noqa: SLF001 - as above
        mujoco.set_mjcb_passive(_add_laws)


def data_of(model: mujoco.MjModel) -> mujoco.MjData:
    """New data for a model, on which its laws act."""
    data = mujoco.MjData(model)
    if model._address in _LAWS:  # noqa: SLF001 - as above
        _DATA[data._address] = data  # noqa: SLF001 - as above
    return data


def _forget(address: int, laws: BoundLaws) -> None:
    """Forget the laws of a freed model, and remove the callback after the last one."""
    with _LOCK:
        # A new model may have got the address already.
        if _LAWS.get(address) is laws:
            del _LAWS[address]
        if not _LAWS:
            mujoco.set_mjcb_passive(None)
