"""A test bench: a session on inline MJCF, without MCP. By default the agent may read all attributes of its objects."""

import re
from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest

from physment_mcp.errors import RefusedCall
from physment_mcp.scene import Scene
from physment_mcp.session import Session
from physment_mcp.tools.calls import call_async, no_progress
from scenes import Permissions, PublicObject, PublicPack

PUBLIC: dict[str, bool] = dict.fromkeys(
    ("geom_type", "geom_density", "body_mass", "geom_size", "geom_radius", "body_pos", "body_quat"), True
)
"""Permissions of an object with all attributes readable."""


def fingerprint(session: Session) -> tuple[Any, ...]:
    """Return a fingerprint of everything that a refused call must not change: the session state and the bytes of the
    world state.
    """
    world = session.world.save()
    return (
        session.state,
        dict(session.state.objects),  # a copy, so that in-place changes are detected, too
        id(world.spec),
        id(world.model),
        id(world.data),
        world.state.tobytes(),
        world.model.geom_rgba.tobytes(),
        world.before_step and world.before_step.state.tobytes(),
        world.disturbed,
        world.revealed,
    )


class Bench:
    """A session and the calls on it, without MCP."""

    def __init__(self, session: Session) -> None:
        self.session = session

    async def __call__(self, tool: str, /, report: Any = no_progress, **arguments: Any) -> dict[str, Any]:
        """The result of a call."""
        return (await call_async(self.session, tool, arguments, report)).model_dump(mode="json")

    async def refused(self, tool: str, /, **arguments: Any) -> str:
        """Make a call that must be refused, check that it changed nothing, and return the error message."""
        before = self.fingerprint()
        with pytest.raises(RefusedCall) as refusal:
            await call_async(self.session, tool, arguments)
        assert self.fingerprint() == before
        return str(refusal.value)

    async def vector(self, tool: str, object_id: Any, **arguments: Any) -> np.ndarray:
        """The vector that a tool returns for an object."""
        result = await self(tool, object_id=object_id, **arguments)
        del result["sim_time"]
        for name in ("orientation", "angle", "angular_velocity"):
            result.pop(name, None)
        (value,) = result.values() if len(result) == 1 else (result,)
        return np.array(list(value.values()) if isinstance(value, dict) else value)

    async def position(self, object_id: Any) -> np.ndarray:
        return await self.vector("get_position", object_id)

    async def velocity(self, object_id: Any) -> np.ndarray:
        return await self.vector("get_velocity", object_id)

    async def number(self, tool: str, object_id: Any, **arguments: Any) -> float:
        """The number that a tool returns for an object."""
        result = await self(tool, object_id=object_id, **arguments)
        (value,) = (value for key, value in result.items() if key != "sim_time")
        return value

    def fingerprint(self) -> tuple[Any, ...]:
        """`fingerprint` of the session."""
        return fingerprint(self.session)


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
    listed = tuple(
        PublicObject(object_id=name, name=name, permissions=Permissions(**{**PUBLIC, **given.get(name, {})}))
        for name in ids
    )
    mjcf = (
        f'<mujoco><compiler angle="degree"/><option timestep="{dt}" integrator="{integrator}" cone="elliptic"'
        f' impratio="10" gravity="{gravity}">{flags}</option><worldbody>{bodies}</worldbody>{rest}</mujoco>'
    )
    return Bench(Session(Scene(public_pack(listed, soft), mjcf)))


def public_pack(listed: tuple[PublicObject, ...], soft: tuple[str, ...] = ()) -> PublicPack:
    """Return the public half of a pack whose only content is a list of objects."""
    return PublicPack(
        scene_id=1,
        name="bench",
        task="?",
        problem_type="calculation",
        objects=listed,
        answer_form=None,
        disabled_tools=(),
        soft_objects=soft,
    )


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
