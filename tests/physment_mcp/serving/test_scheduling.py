"""Tests of the scheduler: requests of an episode run in turn, and none waits long for a slow one."""

import math
from types import SimpleNamespace

import anyio
import pytest
from anyio.abc import TaskStatus

from physment_mcp.serving import scheduling
from physment_mcp.serving.scheduling import Scheduler, Turns


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


async def test_a_long_call_lets_the_next_request_in_and_that_one_has_the_turn() -> None:
    turns, order = Turns(patience_s=math.inf, allowed_s=0), list[str]()

    async def serve(name: str, done: anyio.Event) -> None:
        async with turns.turn():
            order.append(f"{name} begins")
            await done.wait()
        order.append(f"{name} ends")

    second, third = anyio.Event(), anyio.Event()
    with anyio.fail_after(60):
        async with anyio.create_task_group() as tasks:
            async with turns.turn():
                tasks.start_soon(serve, "second", second)
                tasks.start_soon(serve, "third", third)
                await anyio.wait_all_tasks_blocked()
                assert order == []
                give_way = turns.giving_way()
                for _ in range(3):  # it admits one request, however long that takes
                    await give_way()
                    await anyio.wait_all_tasks_blocked()
                assert order == ["second begins"]
            await anyio.wait_all_tasks_blocked()
            assert order == ["second begins"]  # the end of the long call admits no other request
            second.set()
            await anyio.wait_all_tasks_blocked()
            assert order == ["second begins", "second ends", "third begins"]
            third.set()


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


async def serving(turns: Turns, *, task_status: TaskStatus[anyio.Event]) -> None:
    """Serve a request of an episode until the event is set."""
    done = anyio.Event()
    async with turns.turn():
        task_status.started(done)
        await done.wait()


async def test_a_long_call_waits_for_the_requests_of_others_and_then_works_in_brief_pieces() -> None:
    scheduler = Scheduler()
    long, other = Turns(scheduler, allowed_s=0, quiet_s=1e9), Turns(scheduler)
    resumed: list[float | None] = []

    async def give_way() -> None:
        resumed.append(await waits())

    with anyio.fail_after(60):
        async with long.turn(), anyio.create_task_group() as tasks:
            waits = long.giving_way(at_most=1e9)
            await give_way()
            assert resumed == [None]  # no other episode has a request
            done = await tasks.start(serving, other)
            tasks.start_soon(give_way)
            await anyio.wait_all_tasks_blocked()
            assert len(resumed) == 1
            done.set()
            await anyio.wait_all_tasks_blocked()
            assert resumed[1] is not None
            await give_way()
            assert resumed[2] is not None


async def test_pieces_are_as_long_as_usual_again_when_others_have_made_no_requests_for_a_while() -> None:
    scheduler = Scheduler()
    long, other = Turns(scheduler, allowed_s=0, quiet_s=0), Turns(scheduler)
    async with long.turn():
        async with other.turn():
            pass
        assert await long.giving_way(at_most=1e9)() is None


class WatchedTraffic(Scheduler):
    """A scheduler that counts how often it waits for other episodes."""

    waits = 0

    async def quiet(self) -> None:
        self.waits += 1
        await super().quiet()


async def test_whoever_breaks_off_long_calls_gives_way_in_the_next_until_it_has_regained_time(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    now = 0.0
    monkeypatch.setattr(scheduling, "time", SimpleNamespace(monotonic=lambda: now))
    scheduler = WatchedTraffic()
    episode, waits = Turns(scheduler, allowed_s=0.02), list[int]()
    for pause_s in (0.0, 0.0, 0.0, 1.0):
        now += pause_s
        async with episode.turn():
            give_way = episode.giving_way()
            now += 0.012
            await give_way()
            waits.append(scheduler.waits)
    assert waits == [0, 1, 2, 2]


async def test_two_long_calls_do_not_wait_for_each_other_and_busy_episodes_do_not_stop_them() -> None:
    scheduler = Scheduler()
    first, second, busy = Turns(scheduler, allowed_s=0), Turns(scheduler, allowed_s=0), Turns(scheduler)
    with anyio.fail_after(60):
        async with first.turn(), second.turn(), anyio.create_task_group() as tasks:
            one, two = first.giving_way(at_most=1e9), second.giving_way(at_most=1e9)
            async with anyio.create_task_group() as both:
                both.start_soon(one)
                both.start_soon(two)
            done = await tasks.start(serving, busy)
            assert await first.giving_way()() is not None
            done.set()


async def test_a_call_that_is_not_long_waits_for_nobody_but_works_in_brief_pieces_beside_others() -> None:
    scheduler = Scheduler()
    brief, other = Turns(scheduler, allowed_s=math.inf), Turns(scheduler)
    with anyio.fail_after(60):
        async with brief.turn(), anyio.create_task_group() as tasks:
            done = await tasks.start(serving, other)
            assert await brief.giving_way(at_most=1e9)() is not None  # brief pieces, so that others do not wait for it
            done.set()
