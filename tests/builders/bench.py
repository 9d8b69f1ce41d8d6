"""A bench: a session on an inline world whose every object is public unless told otherwise, and the calls on it."""

import re
from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest

from physment_mcp.errors import RefusedCall
from physment_mcp.scene import ListedObject, Scene
from physment_mcp.session import Session
from physment_mcp.tools.calls import call, no_progress
from scenes import Permissions

PUBLIC = {
    "geom_type": True,
    "geom_density": True,
    "body_mass": True,
    "geom_size": True,
    "geom_radius": True,
    "body_pos": True,
    "body_quat": True,
}


class Bench:
    """A session and the calls on it, without MCP."""

    def __init__(self, session: Session) -> None:
        self.session = session

    async def __call__(self, tool: str, /, report: Any = no_progress, **arguments: Any) -> dict[str, Any]:
        """The result of a call."""
        return (await call(self.session, tool, arguments, report)).model_dump(mode="json")

    async def refused(self, tool: str, /, **arguments: Any) -> str:
        """The sentence of a call that is refused; checks that it changed nothing."""
        before = self.fingerprint()
        with pytest.raises(RefusedCall) as refusal:
            await call(self.session, tool, arguments)
        assert self.fingerprint() == before
        return str(refusal.value)

    async def vector(self, tool: str, object_id: Any, **arguments: Any) -> np.ndarray:
        """The vector that a tool returns of an object."""
        result = await self(tool, object_id=object_id, **arguments)
        del result["sim_time"]
        result.pop("orientation", None)
        (value,) = result.values() if len(result) == 1 else (result,)
        return np.array(list(value.values()) if isinstance(value, dict) else value)

    async def position(self, object_id: Any) -> np.ndarray:
        return await self.vector("get_position", object_id)

    async def velocity(self, object_id: Any) -> np.ndarray:
        return await self.vector("get_velocity", object_id)

    async def number(self, tool: str, object_id: Any, **arguments: Any) -> float:
        """The number that a tool returns of an object."""
        result = await self(tool, object_id=object_id, **arguments)
        (value,) = (value for key, value in result.items() if key != "sim_time")
        return value

    def fingerprint(self) -> tuple[Any, ...]:
        """The state, bit by bit, and everything else a refused call must leave as it was."""
        session, world = self.session, self.session.world
        return (
            world._state().tobytes(),
            id(world._model),
            world._before_step is not None and world._before_step.state.tobytes(),
            world._disturbed,
            [(key, id(one)) for key, one in session.objects.items()],
            session.joined,
            session.simulated_s,
            session.created_count,
            session.answer,
            session.over,
        )


def open_bench(
    bodies: str,
    rest: str = "",
    *,
    gravity: str = "0 0 -9.81",
    dt: float = 0.005,
    integrator: str = "RK4",
    permissions: Mapping[int, Mapping[str, bool]] | None = None,
    soft: tuple[str, ...] = (),
    flags: str = "",
) -> Bench:
    """Open a bench on MJCF bodies named object_1, object_2 and so on."""
    given = {f"object_{number}": changes for number, changes in (permissions or {}).items()}
    ids = sorted(re.findall(r'<body name="(object_\d+)"', bodies))
    listed = tuple(ListedObject(one, one, Permissions(**{**PUBLIC, **given.get(one, {})})) for one in ids)
    mjcf = (
        f'<mujoco><compiler angle="degree"/><option timestep="{dt}" integrator="{integrator}" cone="elliptic"'
        f' impratio="10" gravity="{gravity}">{flags}</option><worldbody>{bodies}</worldbody>{rest}</mujoco>'
    )
    scene = Scene(1, "bench", "?", "calculation", listed, None, frozenset(), frozenset(soft), mjcf)
    return Bench(Session(scene))


def ball_mjcf(
    number: int,
    pos: str,
    mass: float = 1.0,
    radius: float = 0.1,
    joint: str = '<joint type="free"/>',
    geom: str = "",
) -> str:
    """MJCF of a ball."""
    return (
        f'<body name="object_{number}" pos="{pos}">{joint}'
        f'<geom type="sphere" size="{radius}" mass="{mass}" {geom}/></body>'
    )
