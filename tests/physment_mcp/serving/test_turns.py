"""The requests of one episode are served one after another, but none waits long for one that takes long."""

import math

import anyio
from anyio.abc import TaskStatus

from physment_mcp.serving.turns import Turns


async def hold(turns: Turns, *, task_status: TaskStatus[None] = anyio.TASK_STATUS_IGNORED) -> None:
    async with turns.turn():
        task_status.started()
        await anyio.sleep_forever()


async def test_one_request_is_served_at_a_time_in_the_order_in_which_they_came() -> None:
    turns, order = Turns(patience_s=math.inf), list[str]()

    async def serve(name: str) -> None:
        async with turns.turn():
            order.append(f"{name} begins")
            for _ in range(5):
                await anyio.lowlevel.checkpoint()
            order.append(f"{name} ends")

    async with anyio.create_task_group() as tasks:
        for name in "abc":
            tasks.start_soon(serve, name)
    assert order == [f"{name} {what}" for name in "abc" for what in ("begins", "ends")]


async def test_a_request_overtakes_one_that_takes_long_and_the_turns_go_on_after_it() -> None:
    turns = Turns(patience_s=0.01)
    with anyio.fail_after(60):
        async with anyio.create_task_group() as tasks:
            await tasks.start(hold, turns)
            for _ in range(3):
                async with turns.turn():
                    pass
            tasks.cancel_scope.cancel()
        async with turns.turn():
            pass


async def test_a_request_that_is_cancelled_while_it_waits_leaves_the_turn_to_others() -> None:
    turns = Turns(patience_s=math.inf)
    with anyio.fail_after(60):
        async with anyio.create_task_group() as tasks:
            await tasks.start(hold, turns)
            async with anyio.create_task_group() as waiting:
                waiting.start_soon(hold, turns)
                await anyio.wait_all_tasks_blocked()
                waiting.cancel_scope.cancel()
            tasks.cancel_scope.cancel()
        async with turns.turn():
            pass


async def test_requests_that_take_long_fill_the_places() -> None:
    turns, served = Turns(patience_s=0), anyio.Event()

    async def serve() -> None:
        async with turns.turn():
            served.set()

    with anyio.fail_after(60):
        async with anyio.create_task_group() as tasks:
            async with anyio.create_task_group() as held:
                for _ in range(8):
                    await held.start(hold, turns)
                tasks.start_soon(serve)
                await anyio.wait_all_tasks_blocked()
                assert not served.is_set()
                held.cancel_scope.cancel()
            await served.wait()
