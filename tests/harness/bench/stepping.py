"""Times of steps, against the engine alone."""

import time
from collections.abc import AsyncGenerator
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


async def rows() -> AsyncGenerator[Row]:
    """Ten simulated seconds of eight boxes, without and with a law."""
    yield await stepping("step(10) of a session", STACK, 1.05)
    yield await stepping("step(10) of a session with a law", STACK_WITH_LAW, 1.2)


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
