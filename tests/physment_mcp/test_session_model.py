"""Compares a session with a model of dictionaries and closed forms, under random calls."""

import math
from dataclasses import dataclass, replace
from typing import Any

import pytest
from hypothesis import Phase, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule, run_state_machine_as_test

from physment_mcp.errors import EpisodeOver, RefusedCall
from physment_mcp.session import Session
from physment_mcp.tools.calls import call
from scenes import LabLimits
from tests.builders.bench import ball_mjcf, fingerprint, open_bench

DT, G = 0.005, 9.81
# A free ball, a hidden ball, a sealed ball and a fixed post. Nothing touches anything: contacts are switched off.
BODIES = (
    ball_mjcf(1, "0 -5 9", mass=2)
    + ball_mjcf(2, "3 -5 9", mass=4)
    + ball_mjcf(3, "6 -5 9", mass=8)
    + ball_mjcf(4, "9 -5 9", joint="")
)
PERMISSIONS = {2: {"hidden": True}, 3: {"actuate": False}}
NAMES = ("probe0", "probe1", "probe2")
ODD_IDS = ("object_1", "1", "object_2", "2", "object_3", "object_4", "4", *NAMES, "nobody")
PICKS = st.integers(0, 39)
"""Strategy for the object that a call names: mostly one on which the agent can act."""
HEIGHTS = st.sampled_from((-2.5, 0.0, 1.25, 40.0))
FORCES = st.sampled_from((0.0, 1.5, -4.0, 5.0, 5.1))


@dataclass(frozen=True)
class Thing:
    """An object in the model. All motion is vertical."""

    mass: float
    height: float
    hidden: bool = False
    sealed: bool = False
    fixed: bool = False
    speed: float = 0.0
    force: float = 0.0
    predictable: bool = True
    """False once the object has been attached to another object."""

    def after(self, duration: float) -> "Thing":
        """Uniform acceleration: z + v t + ½ a t², v + a t."""
        acceleration = 0.0 if self.fixed else self.force / self.mass - G
        height = self.height + self.speed * duration + acceleration * duration**2 / 2
        return replace(self, height=height, speed=self.speed + acceleration * duration)


class SessionModel(RuleBasedStateMachine):
    """Makes the same calls in a session and in the model."""

    @initialize(
        calls=st.sampled_from((None, None, 25)),
        max_calls=st.sampled_from((None, None, None, 30)),
        lab_time=st.sampled_from((None, 1.0, 3.0)),
        created_mass=st.sampled_from((None, 10.0)),
    )
    def open(
        self, calls: int | None, max_calls: int | None, lab_time: float | None, created_mass: float | None
    ) -> None:
        flags = '<flag contact="disable"/>'
        scene = open_bench(BODIES, permissions=PERMISSIONS, flags=flags).session.scene
        self.limits = LabLimits(force=5.0, calls=calls, lab_time=lab_time, created_mass=created_mass)
        scene = replace(scene, public=scene.public.model_copy(update={"limits": self.limits}))
        self.session = Session(scene, max_calls=max_calls)
        self.things = {
            "object_1": Thing(2, 9),
            "object_2": Thing(4, 9, hidden=True),
            "object_3": Thing(8, 9, sealed=True),
            "object_4": Thing(1, 9, fixed=True),
        }
        self.joined: set[frozenset[str]] = set()
        self.max_calls, self.calls, self.counted = max_calls, 0, 0
        self.steps, self.created, self.mass, self.answer = 0, 0, 0.0, None

    def known(self, name: str) -> str | None:
        """The canonical id of an object that the agent knows; None for any other."""
        canonical = f"object_{name}" if name.isdecimal() else name
        thing = self.things.get(canonical)
        return None if thing is None or thing.hidden else canonical

    def picked(self, pick: int) -> str:
        usual = [name for name, thing in self.things.items() if not (thing.hidden or thing.sealed)]
        return usual[pick % len(usual)] if usual and pick < 30 else ODD_IDS[pick % len(ODD_IDS)]

    @property
    def over(self) -> bool:
        return self.answer is not None or (self.max_calls is not None and self.calls >= self.max_calls)

    def tell(self, tool: str, allowed: bool, **arguments: Any) -> dict[str, Any] | None:
        """Make a call, check that it is refused if and only if the reference model refuses it; return its result."""
        before = fingerprint(self.session)
        if self.over:
            with pytest.raises(EpisodeOver):
                call(self.session, tool, arguments)
            assert fingerprint(self.session) == before
            return None
        self.calls += 1
        if tool != "answer":
            if self.counted == self.limits.calls:
                allowed = False
            else:
                self.counted += 1
        if allowed:
            return call(self.session, tool, arguments).model_dump()
        with pytest.raises(RefusedCall):
            call(self.session, tool, arguments)
        assert fingerprint(self.session) == before
        return None

    @rule(duration=st.sampled_from((1e-9, 0.005, 0.0124, 0.1, 0.35, 1.0)))
    def step(self, duration: float) -> None:
        steps = max(1, round(duration / DT))
        allowed = round((self.limits.lab_time or 3600) / DT)
        result = self.tell("step", self.steps + steps <= allowed, duration=duration)
        if result is not None:
            self.steps += steps
            self.things = {name: thing.after(steps * DT) for name, thing in self.things.items()}
            assert result["steps"] == steps
            assert result["lab_time_left"] == pytest.approx((allowed - self.steps) * DT, abs=1e-8)
            assert result["calls_left"] == (None if self.limits.calls is None else self.limits.calls - self.counted)

    @rule(
        name=st.sampled_from((*NAMES, *NAMES, "object_7", "9lives")),
        height=HEIGHTS,
        radius=st.sampled_from((0.05, 0.1)),
    )
    def create(self, name: str, height: float, radius: float) -> None:
        mass = 1000 * 4 / 3 * math.pi * radius**3
        fits = self.limits.created_mass is None or self.mass + mass <= self.limits.created_mass
        allowed = name in NAMES and name not in self.things and fits
        place = [3.0 * (NAMES.index(name) if name in NAMES else 7), 5.0, height]
        colour = [1, 0, 0, 1]
        if self.tell("create_objects", allowed, name=name, pos=place, density=1000, rgba=colour, radius=radius):
            self.things[name] = Thing(mass, height)
            self.created, self.mass = self.created + 1, self.mass + mass

    @rule(pick=PICKS)
    def delete(self, pick: int) -> None:
        name = self.picked(pick)
        found = self.known(name)
        if self.tell("delete_objects", bool(found and not self.things[found].sealed), object_id=name) and found:
            del self.things[found]
            self.joined = {pair for pair in self.joined if found not in pair}

    @rule(one=PICKS, other=PICKS, joint=st.sampled_from(("weld", "ball")))
    def attach(self, one: int, other: int, joint: str) -> None:
        first, second = self.picked(one), self.picked(other)
        pair = [found for found in (self.known(first), self.known(second)) if found]
        things = [self.things[name] for name in pair]
        allowed = (
            len(set(pair)) == 2
            and frozenset(pair) not in self.joined
            and not any(thing.sealed for thing in things)
            and not all(thing.fixed for thing in things)
        )
        if self.tell("attach_objects", allowed, object1_id=first, object2_id=second, joint=joint):
            self.joined.add(frozenset(pair))
            self.things |= {name: replace(self.things[name], predictable=False) for name in pair}

    @rule()
    def find(self) -> None:
        result = self.tell("find_objects", allowed=True)
        if result is not None:
            self.things = {name: replace(thing, hidden=False) for name, thing in self.things.items()}
            assert [item["object_id"] for item in result["revealed"]] == [n for n in self.things if n == "object_2"]

    @rule(pick=PICKS, force=FORCES)
    def push(self, pick: int, force: float) -> None:
        name = self.picked(pick)
        found = self.movable(name)
        if self.tell("apply_force", bool(found) and abs(force) <= 5, object_id=name, force_vector=[0, 0, force]):
            self.things[found] = replace(self.things[found], force=force)

    @rule(pick=PICKS, speed=st.sampled_from((0.0, 3.0, -1.5)))
    def throw(self, pick: int, speed: float) -> None:
        name = self.picked(pick)
        found = self.movable(name)
        if self.tell("set_velocity", bool(found), object_id=name, velocity_vector=[0, 0, speed]):
            self.things[found] = replace(self.things[found], speed=speed)

    def movable(self, name: str) -> str:
        found = self.known(name)
        return found if found and not (self.things[found].sealed or self.things[found].fixed) else ""

    @rule(pick=PICKS)
    def read(self, pick: int) -> None:
        name = self.picked(pick)
        found = self.known(name)
        result = self.tell("get_position", bool(found), object_id=name)
        if result is not None and found and self.things[found].predictable:
            assert result["position"][2] == pytest.approx(self.things[found].height, rel=1e-9, abs=1e-9)

    @rule(tool=st.sampled_from(("step", "get_position", "no_such_tool")))
    def err(self, tool: str) -> None:
        self.tell(tool, allowed=False, wrong=1)

    @rule(chance=st.integers(0, 9), value=st.sampled_from((1.5, "left")))
    def give_answer(self, chance: int, value: object) -> None:
        if chance == 0 and self.tell("answer", allowed=True, answer=value):
            self.answer = value

    @invariant()
    def agrees(self) -> None:
        session = self.session
        state = session.state
        assert {item.object_id for item in session.known()} == {
            n for n, thing in self.things.items() if not thing.hidden
        }
        assert set(state.objects) == set(self.things)
        assert state.joined == self.joined
        in_pairs = {name for pair in self.joined for name in pair}
        assert {name for name, item in state.objects.items() if item.attached} == in_pairs
        assert (state.created_count, state.created_mass) == (self.created, pytest.approx(self.mass))
        assert (session.calls, session.counted_calls, session.ended) == (self.calls, self.counted, self.over)
        assert session.world.time == pytest.approx(self.steps * DT, abs=1e-9)
        assert state.simulated_s == pytest.approx(self.steps * DT, abs=1e-9)
        assert (state.answer, state.answered) == (self.answer, self.answer is not None)
        for name, thing in self.things.items():
            if thing.predictable:
                body = state.objects[name].body
                assert session.world.pose(body).position[2] == pytest.approx(thing.height, rel=1e-9, abs=1e-9)
                assert session.world.twist(body).linear[2] == pytest.approx(thing.speed, rel=1e-9, abs=1e-9)


def test_the_session_agrees_with_its_model() -> None:
    run_state_machine_as_test(
        SessionModel, settings=settings(max_examples=90, stateful_step_count=40, derandomize=True, deadline=None)
    )


class ForgetfulSession(SessionModel):
    """The model of a faulty laboratory that forgets a pair when one of the two is pushed."""

    @rule(pick=PICKS)
    def push_and_forget(self, pick: int) -> None:
        name = self.picked(pick)
        found = self.known(name)
        self.joined = {pair for pair in self.joined if found not in pair}


def test_a_model_that_differs_is_told_from_the_session() -> None:
    chosen = settings(max_examples=60, stateful_step_count=40, derandomize=True, deadline=None, phases=[Phase.generate])
    with pytest.raises(AssertionError):
        run_state_machine_as_test(ForgetfulSession, settings=chosen)
