"""Tests of synthetic takers: the effect of each handicap, and that a stronger handicap includes the weaker ones."""

import itertools
from typing import Any

import pytest

from evaluator.agents.reference import ProtocolPlayer
from evaluator.agents.takers import LAWS, TAKERS, Handicap, TakerAgent, _TakerPlayer, parse_handicap
from evaluator.certify.verify import MemoryConnector
from evaluator.episode.loop import play_episode
from evaluator.episode.player import Feedback, Reply
from evaluator.errors import AgentError, UsageError
from evaluator.records.episode import Episode, Exchange, ToolCall
from evaluator.study.run_config import RunConfig, participants_of
from scenes import default_folder
from scenes.protocol import Member, Protocol, answer, call
from tests.builders.records import VERSIONS, episode_key
from tests.harness.takers import inversions, report

PUSHES = 200
TRUTH = {"velocity": [2.0, 0.0, -4.0], "angular_velocity": [1.0, 1.0, 1.0], "sim_time": 0.5}


def pushing(task: str) -> Protocol:
    """A protocol that pushes and reads many times, and answers with the speeds that were read."""
    calls = [call("apply_force", object_id="object_1", force_vector=[8, 0, -2.0]), call("get_velocity", object_id="a")]
    readings = yield calls * PUSHES
    yield [answer([reading["velocity"][0] for reading in readings[1::2] if reading])]


class Played:
    """The calls and the answer of a taker if every reading is `TRUTH`."""

    def __init__(self, player: _TakerPlayer) -> None:
        self.player = player
        self.calls: list[Any] = []

    async def run(self) -> Any:
        reply: Reply = await self.player.act(None)
        while not any(made.tool == "answer" for made in reply.calls):
            self.calls += reply.calls
            exchanges = [Exchange(call=made, returned=True, content=dict(TRUTH)) for made in reply.calls]
            reply = await self.player.act(Feedback(exchanges, "", 5))
        return reply.calls[-1].arguments["answer"]


def player(handicap: str, noise: dict[str, float] | None = None, rivals: Any = None) -> _TakerPlayer:
    return _TakerPlayer(ProtocolPlayer(pushing, ""), parse_handicap(handicap), noise or {}, rivals, "salt")


async def answered(handicap: str, noise: dict[str, float] | None = None, rivals: Any = None) -> Any:
    return await Played(player(handicap, noise, rivals)).run()


async def test_calls_beyond_the_limit_are_not_made_and_the_protocol_goes_on_without_their_readings() -> None:
    played = Played(player("calls-7"))
    assert await played.run() == [2.0] * 3
    assert [made.tool for made in played.calls] == ["apply_force", "get_velocity"] * 3 + ["apply_force"]


async def test_noise_is_in_units_of_the_stated_noise_and_scales_with_the_handicap() -> None:
    once, thrice = [await answered(name, {"velocity": 0.5}) for name in ("noise-1", "noise-3")]
    errors = [value - 2.0 for value in once]
    assert [value - 2.0 for value in thrice] == pytest.approx([3 * error for error in errors])
    assert sum(error**2 for error in errors) / PUSHES == pytest.approx(0.5**2, rel=0.3)


async def test_without_stated_noise_it_is_in_per_cent_of_the_reading_and_the_clock_has_none() -> None:
    errors = [value - 2.0 for value in await answered("noise-1")]
    assert sum(error**2 for error in errors) / PUSHES == pytest.approx(0.02**2, rel=0.3)
    distorted = player("noise-8")._distorted(dict(TRUTH), 0)
    assert distorted is not None
    assert distorted["sim_time"] == TRUTH["sim_time"]
    assert distorted["angular_velocity"] != TRUTH["angular_velocity"]
    assert player("none")._distorted(dict(TRUTH), 0) == TRUTH


async def test_slips_halve_the_numbers_of_acts_and_more_slips_include_fewer() -> None:
    halved: list[set[int]] = []
    for handicap in ("slips-3", "slips-10", "slips-30"):
        played = Played(player(handicap))
        await played.run()
        acts = [made.arguments["force_vector"] for made in played.calls if made.tool == "apply_force"]
        assert all(vector in ([8, 0, -2.0], [4.0, 0.0, -1.0]) for vector in acts)
        halved.append({number for number, vector in enumerate(acts) if vector[0] == 4.0})
    assert halved[0] < halved[1] < halved[2]
    assert len(halved[2]) / PUSHES == pytest.approx(0.3, abs=0.1)


def fits(_exchanges: object) -> dict[str, Member]:
    """Return fits of four structures, of which d fits best and c second best."""
    return {name: Member(cost, 9, 1, name, lambda _: []) for name, cost in zip("abcd", (90, 80, 70, 10), strict=True)}


async def test_a_taker_answers_by_the_best_law_that_it_knows() -> None:
    assert await answered("wrong-law", rivals=fits) == "c"
    order = sorted("abcd", key=lambda name: player("none")._source("law", name))
    known = {law: min(order[unknown:], key="dcba".index) for law, unknown in zip(LAWS, (1, 2, 3), strict=False)}
    for law, best in known.items():
        assert await answered(law, rivals=fits) == best
    # A scene without a family is played as the reference plays it.
    assert await answered("wrong-law") == [2.0] * PUSHES


def test_a_taker_that_does_not_know_the_inferred_law_states_none() -> None:
    asked = ToolCall(tool="answer", arguments={"answer": 1.0, "law": {"ax_1": "0"}})
    for handicap, states in (("wrong-law", False), ("calls-3", True)):
        taker = player(handicap, rivals=fits)
        assert ("law" in taker._fitted(asked).arguments) is states


async def test_a_protocol_that_needs_more_readings_is_answered_by_the_best_fit_if_the_scene_has_a_family() -> None:
    assert await _failing("calls-3", fits) == "d"
    for handicap, rivals in (("calls-3", None), ("none", fits)):
        with pytest.raises(AgentError, match="KeyError"):
            await _failing(handicap, rivals)


async def _failing(handicap: str, rivals: Any) -> Any:
    def needy(task: str) -> Protocol:
        """A protocol that uses a field that no reading has."""
        readings = yield [call("get_velocity", object_id="a")] * 5
        yield [answer(readings[4]["never"])]

    return await Played(_TakerPlayer(ProtocolPlayer(needy, ""), parse_handicap(handicap), {}, rivals, "")).run()


async def _episode(taker: str) -> Episode:
    agent = TakerAgent(taker)
    async with MemoryConnector(default_folder()).open(7, 0) as client:
        return await play_episode(agent, client, episode_key(7, agent=agent.name), VERSIONS)


async def test_a_taker_plays_a_scene_of_the_suite_and_the_record_holds_what_the_laboratory_returned() -> None:
    exact, noisy = [await _episode(taker) for taker in ("none", "noise-50")]
    (before,), (after,) = ([turn.exchanges[1].content for turn in one.turns[:1]] for one in (exact, noisy))
    assert before == after
    assert exact.answer != noisy.answer
    assert (await _episode("calls-1")).error == "the protocol failed: KeyError('velocity')"


def test_thirty_takers_are_named_once_and_partially_ordered() -> None:
    handicaps = [parse_handicap(name) for name in TAKERS]
    assert len(set(handicaps)) == len(TAKERS) == 30
    assert all(Handicap().is_within(one) for one in handicaps)
    assert not any(a.is_within(b) and b.is_within(a) for a, b in itertools.combinations(handicaps, 2))
    assert parse_handicap("calls-60+noise-1").is_within(parse_handicap("calls-40+noise-2"))
    assert not parse_handicap("calls-60+noise-4").is_within(parse_handicap("calls-40+noise-2"))
    participants = participants_of(RunConfig(agents=("taker:noise-3", "taker:no-check")))
    assert list(participants) == ["taker:noise-3", "taker:no-check"]


@pytest.mark.parametrize("name", ["noise", "noise--1", "calls-x", "sleep-3", "noise-1+", "none+noise-1"])
def test_an_unknown_handicap_is_refused_in_one_sentence(name: str) -> None:
    with pytest.raises(UsageError, match="there is no handicap") as refused:
        TakerAgent(name)
    assert "\n" not in str(refused.value)


def test_the_report_lists_scenes_in_which_the_milder_taker_is_right_less_often() -> None:
    shares = {"none": (3, 1, 2), "noise-4": (2, 3, 3), "calls-12": (1, 3, 2), "calls-12+noise-4": (0, 1, 2)}
    right = {(scene, taker): row[place] for place, scene in enumerate((7, 8, 9)) for taker, row in shares.items()}
    assert {(found.scene, found.milder, found.severer) for found in inversions(right, 3)} == {
        (8, "none", "noise-4"),
        (8, "none", "calls-12"),
    }
    lines = list(report(right, 3))
    assert lines[-1] == "ordered in 2 of 3 scenes"
    assert lines[-3] == "scene 8: 2 pairs in the wrong order, such as none 1, noise-4 3 of 3"
