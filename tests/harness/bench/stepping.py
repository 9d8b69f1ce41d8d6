"""Times steps of a session and compares them with the engine alone."""

import json
import time
from collections.abc import AsyncGenerator, Awaitable, Callable
from xml.sax.saxutils import quoteattr

import mujoco

from physment_mcp.scene import Scene, load_scene
from physment_mcp.session import Session
from physment_mcp.tools.calls import call_async
from tests.harness.bench.measuring import Row, compare

SCENE = 7

_BOX = '<body name="object_{0}" pos="{1} 0 {2}"><joint type="free"/><geom type="box" size=".1 .1 .1"/></body>'
_BOXES = "".join(_BOX.format(i, 0.01 * i, 0.3 + 0.3 * i) for i in range(1, 9))
STACK = f'<mujoco><option timestep="0.005"/><worldbody><geom type="plane" size="5 5 .1"/>{_BOXES}</worldbody></mujoco>'
_LAW = '[{"on": "object_1", "let": {"v": "hypot(vx, vy)"}, "force": ["-0.001*v*vx", "-0.001*v*vy", "0"]}]'
STACK_WITH_LAW = STACK.replace("<world", f"<custom><text name='laws' data={quoteattr(_LAW)}/></custom><world")
_PUCK = '<body name="object_1"><joint type="slide" axis="1 0 0"/><joint type="slide"/><geom size=".1" mass="1"/></body>'
_TERMS = (
    "-0.4*{v}", "-0.1*{v}*hypot(vx, vy)", "-0.3*{p}", "0.5*sin({p}+1)", "0.2*cos(2*t)*{p}", "-0.2*{p}/(1+hypot(x, z))",
    "0.1*tanh({v})",
)  # fmt: skip
"""Forces along a line that depend on position and velocity, as in a world of a high level."""


def _puck(laws: int) -> str:
    written = [
        {"on": "object_1", "force": [term.format(v="vx", p="x"), "0", term.format(v="vz", p="z")]}
        for term in _TERMS[:laws]
    ]
    text = f"<custom><text name='laws' data={quoteattr(json.dumps(written))}/></custom>"
    option = '<option timestep="0.005" integrator="RK4" gravity="0 0 0"/>'
    return f"<mujoco>{option}{text}<worldbody>{_PUCK}</worldbody></mujoco>"


async def rows() -> AsyncGenerator[Row]:
    """Yield rows: ten simulated seconds of eight boxes, without and with a law, and of a puck with seven laws."""
    yield await stepping("step(10) of a session", STACK, 1.05)
    yield await stepping("step(10) of a session with a law", STACK_WITH_LAW, 1.2)
    yield await seven_laws()


async def stepping(what: str, mjcf: str, aim: float) -> Row:
    """Time ten simulated seconds of eight boxes in a session, compared with the engine alone, without laws."""
    scene = Scene(load_scene(SCENE).public.model_copy(update={"objects": ()}), mjcf)
    model = mujoco.MjModel.from_xml_string(STACK)

    async def ours() -> float:
        session = Session(scene)
        start = time.perf_counter()
        await call_async(session, "step", {"duration": 10.0})
        return time.perf_counter() - start

    async def theirs() -> float:
        data = mujoco.MjData(model)
        start = time.perf_counter()
        mujoco.mj_step(model, data, 2000)
        return time.perf_counter() - start

    return await compare(f"{what}, against mj_step(nstep)", ours, theirs, 21, aim)


async def seven_laws() -> Row:
    """Compare a puck with seven laws and the same puck with one law: common work must be done only once."""

    def ten_seconds(laws: int) -> Callable[[], Awaitable[float]]:
        scene = Scene(load_scene(SCENE).public.model_copy(update={"objects": ()}), _puck(laws))

        async def timed() -> float:
            session = Session(scene)
            start = time.perf_counter()
            await call_async(session, "step", {"duration": 10.0})
            return time.perf_counter() - start

        return timed

    return await compare("step(10) of a puck with seven laws, against one law", ten_seconds(7), ten_seconds(1), 21, 2.0)
