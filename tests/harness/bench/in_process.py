"""Times the Python library in a training loop (readings, steps and edits) against the engine alone.

python -m tests.harness.bench.in_process prints these rows only.
"""

from collections.abc import AsyncGenerator

import anyio
import mujoco

from physment_mcp import open_episode
from physment_mcp.scene import load_scene
from physment_mcp.session import Session
from physment_mcp.session_state import SessionState
from physment_mcp.tools.calls import call
from physment_mcp.world import Snapshot
from physment_mcp.world.loading import STATE, carry_state
from tests.harness.bench.measuring import Row, Work, busy_against_aim, compare_busy

SIZES = (17, 9, 7, 8, 25)
"""Scenes without laws, with 0, 1, 6, 12 and 18 degrees of freedom."""
LONG_S = 10.0
PLAIN = 7
NEW: dict[str, object] = {"name": "p", "pos": [5.0, 5.0, 5.0], "density": 100.0, "rgba": [1, 0, 0, 1]}
PAIR: dict[str, object] = {"object1_id": "p", "object2_id": "object_1", "joint": "ball"}
Moment = tuple[Snapshot, SessionState]


async def rows() -> AsyncGenerator[Row]:
    """Yield the rows of the table."""
    episode = open_episode(PLAIN, 1)

    def reading() -> object:
        return episode.call("get_velocity", object_id="object_1")

    yield busy_against_aim("reading in process", reading, 15e-6, calls=500)
    yield busy_against_aim("step of one time step in process", _short_steps(), 60e-6, calls=100)
    yield busy_against_aim("episode in process: open, 5 readings, 5 steps, answer", _episode, 2.5e-3, calls=20)
    for scene in SIZES:
        for length in (1.0, LONG_S):
            yield _stepping(scene, length)
    for row in _edits():
        yield row


def _short_steps() -> Work:
    """Time calls of one time step each; open a new episode when the laboratory time is used up."""
    left = [open_episode(PLAIN, 1)]

    def step() -> object:
        if left[0].calls > 100_000:
            left[0] = open_episode(PLAIN, 1)
        return left[0].call("step", duration=0.005)

    return step


def _episode() -> None:
    episode = open_episode(PLAIN, 1)
    for _ in range(5):
        episode.call("get_velocity", object_id="object_1")
        episode.call("step", duration=0.005)
    episode.call("answer", answer=9.81)


def _stepping(scene: int, length: float) -> Row:
    """Compare a step of a session with `mj_step(nstep)` from the same state."""
    session = Session(load_scene(scene, 1))
    world, start = session.world, session.world.save()
    data, steps = mujoco.MjData(start.model), world.whole_steps(length)

    def ours() -> None:
        session.state = beginning
        world.restore(start)
        call(session, "step", {"duration": length})

    def theirs() -> None:
        # `restore` resets data as well; both sides step from the start.
        mujoco.mj_resetData(start.model, data)
        mujoco.mj_setState(start.model, data, start.state, STATE)
        mujoco.mj_step(start.model, data, steps)

    beginning = session.state
    return compare_busy(
        f"step({length:g}) of scene {scene}, against mj_step(nstep)", ours, theirs, 1.02, calls=4, rounds=41
    )


def _edits() -> list[Row]:
    """Compare each edit, repeated from the same state, with the engine operations that it cannot avoid."""
    session = Session(load_scene(PLAIN, 1))
    plain = session.world.save(), session.state
    call(session, "create_objects", NEW)
    made = session.world.save(), session.state
    call(session, "attach_objects", PAIR)
    joined = session.world.save(), session.state

    def row(tool: str, arguments: dict[str, object], before: Moment, after: Moment) -> Row:
        def ours() -> None:
            session.world.restore(before[0])
            session.state = before[1]
            call(session, tool, arguments)

        def theirs() -> None:
            carry_state(before[0].model, before[0].data, spec.compile())

        spec = after[0].spec.copy()
        return compare_busy(f"{tool}, against spec.compile() and the state's transfer", ours, theirs, 1.2, calls=5)

    return [
        row("create_objects", NEW, plain, made),
        row("attach_objects", PAIR, made, joined),
        row("delete_objects", {"object_id": "p"}, joined, plain),
    ]


async def main() -> None:
    """Print the rows."""
    async for row in rows():
        print(f"{row.what:75} {1e6 * row.ours_s:10.1f} µs {1e6 * row.theirs_s:10.1f} µs {row.ratio:7.3f} ≤ {row.aim:g}")


if __name__ == "__main__":
    anyio.run(main)
