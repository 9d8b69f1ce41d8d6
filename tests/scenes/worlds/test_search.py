"""Tests of the reference that knows only the grammar: it parses the prompt, finds terms, and predicts."""

import random
import threading
from dataclasses import replace
from pathlib import Path

import anyio
import anyio.lowlevel
import anyio.to_thread
import numpy as np
import pytest

import physment_mcp
from evaluator.agents.grammar import GrammarAgent
from evaluator.episode.player import Briefing, Reply
from evaluator.errors import AgentError
from evaluator.records.episode import EpisodeKey
from scenes.errors import WorldError
from scenes.protocol import ANSWER, Protocol, call
from scenes.worlds.answering import answers
from scenes.worlds.catalogue import FORMS
from scenes.worlds.course_fits import on_course
from scenes.worlds.drawing import draw_constants
from scenes.worlds.expansion import expand
from scenes.worlds.experiment import Situation, simulated
from scenes.worlds.levels import GRAMMAR
from scenes.worlds.parts import Apparatus
from scenes.worlds.predictions import plausible, predicted, weighed
from scenes.worlds.protocols import blind_protocol
from scenes.worlds.questions import Question, tolerance
from scenes.worlds.records import WorldRecord
from scenes.worlds.refits import constants_of
from scenes.worlds.search import Search
from scenes.worlds.task_reading import questions_of, situation_of
from scenes.worlds.terms import Structure, Term
from scenes.worlds.weak_form import Legs, named, to_unit

STRUCTURES = {
    "hidden": Structure(Apparatus.WHEEL, (Term("friction"), Term("swinger"))),
    "way": Structure(Apparatus.GLIDER, (Term("friction", ("wear",)), Term("slope"))),
    "pair": Structure(Apparatus.PAIR, (Term("linear drag"), Term("wake"), Term("mutual spring"))),
    "responder": Structure(Apparatus.PUCK, (Term("linear drag"), Term("responder"))),
}


def told_of(structure: Structure, looks: int = 40, noise: float = 0.002) -> Situation:
    return Situation(structure.apparatus, structure.radius, 5.0, looks, noise)


def questions(apparatus: Apparatus) -> tuple[Question, ...]:
    """Return questions that together use every wording of a prompt for this apparatus."""
    size = 4 if apparatus is Apparatus.PAIR else 2 if apparatus is Apparatus.PUCK else 1
    whats = ("dx", "vy", "speed") if size > 1 else ("dq", "u", "u")
    still, moving = (0.0,) * size, (1.5, -0.25, 0.0, 0.0)[:size]
    body = 2 if apparatus is Apparatus.PAIR else 1
    place = (0.5, -1.25, 2.0, 0.01)[:size]
    return (
        Question("strong", place, still, (9.5, 1.0, 0.0, 0.0)[:size], 0.0, 1.5, whats[0], body),
        Question("late", place, moving, (-0.5, 1.0, 0.0, 0.0)[:size], 31.0, 2.0, whats[1], body),
        Question("strong", place, still, still, 0.0, 2.5, whats[2], body),
    )


def record_of(structure: Structure, looks: int = 20) -> WorldRecord:
    told = told_of(structure, looks)
    return WorldRecord(
        grammar=GRAMMAR, level=1, index=0, split="train", salt="s", apparatus=structure.apparatus,
        terms=tuple((term.form, term.modulations) for term in structure.terms),
        constants=draw_constants(structure, random.Random(1)), radius=told.radius, force=told.force,
        looks=told.looks, noise=told.noise, questions=questions(structure.apparatus),
    )  # fmt: skip


@pytest.mark.parametrize("structure", STRUCTURES.values(), ids=STRUCTURES)
def test_legs_of_the_true_law_leave_the_noise(structure: Structure) -> None:
    constants, told = draw_constants(structure, random.Random(2)), told_of(structure)
    course = simulated(structure, constants, told, 3)
    unit = np.array([to_unit(bounds, constants[name]) for name, bounds in structure.ranges.items()])
    legs = Legs.of(course, told)
    for _ in range(2):
        legs = legs.about(structure, unit).smoothed(structure, unit)
    misfits = legs.about(structure, unit).misfits(structure, unit[:, None])[: course.count, 0]
    deviations = (float(misfits @ misfits) - course.count) / np.sqrt(2 * course.count)
    assert abs(deviations) < 4


@pytest.mark.parametrize("structure", STRUCTURES.values(), ids=STRUCTURES)
def test_trials_of_legs_do_not_depend_on_each_other(structure: Structure) -> None:
    told = told_of(structure, 12)
    legs = Legs.of(simulated(structure, draw_constants(structure, random.Random(2)), told, 3), told)
    units = np.full((len(structure.ranges), 4), 0.4)
    units[0, 1], units[-1, 2], units[:, 3] = (
        0.6,
        0.7,
        0.2,
    )  # the first constant is a mass
    together = legs.ends(structure, named(structure, units), 4)
    for trial in range(4):
        alone = legs.ends(structure, named(structure, units[:, [trial]]), 1)
        assert together[:, :, trial] == pytest.approx(alone[:, :, 0], rel=1e-12, abs=1e-12)
        assert trial == 0 or np.abs(together[:, :, trial] - together[:, :, 0]).max() > 1e-6


def test_the_missing_modulation_is_among_the_first_changes_that_are_fitted() -> None:
    structure = Structure(Apparatus.GLIDER, (Term("friction", ("step",)), Term("spring")))
    constants, told = draw_constants(structure, random.Random(4)), told_of(structure)
    search = Search(Legs.of(simulated(structure, constants, told, 3), told))
    plain = Structure(Apparatus.GLIDER, (Term("friction"), Term("spring")))
    node = search.fit(plain, np.full(len(plain.ranges), 0.5), 8)
    first = [changed for changed, _ in search.promising(node, frozenset())]
    assert structure in first[:3]
    assert plain not in first
    assert len(set(first)) == len(first)


CHANGES = {
    "a modulation in place of another": (
        Structure(Apparatus.GLIDER, (Term("friction", ("step", "wear")), Term("spring"))),
        Structure(Apparatus.GLIDER, (Term("friction", ("beat", "wear")), Term("spring"))),
        Structure(Apparatus.GLIDER, (Term("friction", ("step", "wear")), Term("spring"))),
    ),
    "a modulation that another term has": (
        Structure(Apparatus.WHEEL, (Term("drag cup", ("fading",)), Term("dry friction"), Term("slope"))),
        Structure(Apparatus.WHEEL, (Term("drag cup"), Term("dry friction", ("fading",)), Term("slope"))),
        Structure(Apparatus.WHEEL, (Term("drag cup", ("fading",)), Term("dry friction", ("fading",)), Term("slope"))),
    ),
    "a form whose modulations are kept": (
        Structure(Apparatus.WHEEL, (Term("friction", ("beat", "wear")), Term("slope"))),
        Structure(Apparatus.WHEEL, (Term("power friction", ("beat", "wear")), Term("slope"))),
        Structure(Apparatus.WHEEL, (Term("friction", ("beat", "wear")), Term("slope"))),
    ),
    "a term in place of two": (
        Structure(Apparatus.PUCK, (Term("linear drag", ("outward",)), Term("saddle"))),
        Structure(Apparatus.PUCK, (Term("power drag", ("outward",)), Term("saddle"), Term("saturating drag"))),
        Structure(Apparatus.PUCK, (Term("linear drag", ("outward",)), Term("saddle"))),
    ),
}


@pytest.mark.parametrize(("true", "begun", "wanted"), CHANGES.values(), ids=CHANGES)
def test_a_change_of_two_parts_is_among_those_that_are_fitted(
    true: Structure, begun: Structure, wanted: Structure
) -> None:
    constants, told = draw_constants(true, random.Random(4)), told_of(true)
    search = Search(Legs.of(simulated(true, constants, told, 3), told))
    node = search.fit(begun, np.full(len(begun.ranges), 0.5), 8)
    assert wanted not in [changed for changed, _ in search.promising(node, frozenset())]
    assert wanted in [changed for changed, _ in search.promising(node, frozenset(), wide=True)]


def test_a_law_is_refitted_without_a_part_before_another_is_chosen() -> None:
    def brake(*modulations: str) -> Structure:
        return Structure(Apparatus.WHEEL, (Term("dry friction", modulations), Term("ratchet"), Term("slope")))

    true, begun = brake("step", "wear"), brake("fading", "step")
    constants, told = draw_constants(true, random.Random(5)), told_of(true)
    search = Search(Legs.of(simulated(true, constants, told, 3), told))
    node = search.fit(begun, np.full(len(begun.ranges), 0.5), 8)
    assert true in [changed for changed, _ in search.promising(node, frozenset(), wide=True)]


def test_the_search_returns_structures_of_the_grammar() -> None:
    true, _, repeated = CHANGES["a modulation that another term has"]
    assert repeated.repeats
    assert not true.repeats
    course = simulated(true, draw_constants(true, random.Random(4)), told_of(true), 3)
    search = Search(Legs.of(course, told_of(true)), seconds=5.0)
    assert not any(fit.structure.repeats for fit in search.run())


def test_the_search_goes_on_until_a_fit_in_sequence_confirms_its_law(monkeypatch: pytest.MonkeyPatch) -> None:
    structure = Structure(Apparatus.WHEEL, (Term("friction"), Term("slope")))
    constants, told = draw_constants(structure, random.Random(4)), told_of(structure)
    legs = Legs.of(simulated(structure, constants, told, 3), told)
    search = Search(legs, seconds=60.0)
    search.fit(Structure(Apparatus.WHEEL, ()), np.array([0.5]), 8)
    assert not search.is_confirmed()
    assert search.run()[0].structure == structure
    assert search.is_confirmed()
    assert not search.over
    asked = list[bool]()

    def refuse(search: Search) -> bool:
        asked.append(search.explained)
        search.halted.set()
        return False

    monkeypatch.setattr(Search, "is_confirmed", refuse)
    assert Search(legs, seconds=60.0).run()[0].structure == structure
    assert asked == [True]


def test_intervals_are_wider_if_nothing_explains_the_readings(monkeypatch: pytest.MonkeyPatch) -> None:
    structure = Structure(Apparatus.WHEEL, (Term("friction"), Term("shaker")))
    told, asked = told_of(structure), questions(Apparatus.WHEEL)
    course = simulated(structure, draw_constants(structure, random.Random(4)), told, 1)
    search = Search(Legs.of(course, told))
    search.fit(Structure(Apparatus.WHEEL, (Term("friction"),)), np.full(2, 0.5), 8)
    found = weighed(search, search.best(), asked)
    assert not found.known
    monkeypatch.setattr("scenes.worlds.predictions.EXPLAINED", float("inf"))
    narrow = weighed(search, search.best(), asked)
    assert ((found.high - found.low) > 5 * (narrow.high - narrow.low))[:2].all()


@pytest.mark.parametrize("apparatus", Apparatus)
def test_a_task_is_read_from_its_prompt(apparatus: Apparatus, tmp_path: Path) -> None:
    forms = ("linear drag", "mutual spring") if apparatus is Apparatus.PAIR else ("linear drag",)
    record = record_of(Structure(apparatus, tuple(map(Term, forms if apparatus.flat else ("friction",)))))
    expand(record, tmp_path)
    prompt = physment_mcp.open_episode(record.scene_id, 0, scenes_dir=tmp_path).prompt
    told = situation_of(prompt)
    assert replace(told, looks=record.looks) == record.told
    assert told.legs == record.told.legs
    assert [replace(one, kind="") for one in questions_of(prompt)] == [
        replace(one, kind="") for one in record.questions
    ]


@pytest.mark.parametrize("apparatus", Apparatus)
def test_the_further_kinds_of_questions_are_read_from_a_prompt(apparatus: Apparatus, tmp_path: Path) -> None:
    pair, flat = apparatus is Apparatus.PAIR, apparatus.flat
    structure = Structure(
        apparatus, tuple(map(Term, ("linear drag", "mutual spring")[: 1 + pair] if flat else ("friction",)))
    )
    options = ("linear drag", "saturating drag", "turn") if flat else ("friction", "dry friction", "shaker")
    size = 4 if pair else 2 if flat else 1
    still, way = (0.0,) * size, (0.0, -1.0, 0.0, 0.0)[:size] if flat else (-1.0,)
    place = (0.5, -1.25, 2.0, 0.01)[:size]
    far = Question("apart", place, still, (9.0, 0.0, 0.0, 0.0)[:size], 0.0, 1.5, "apart")
    asked = (
        far if pair else replace(far, kind="strong", what="dx" if flat else "dq"),
        Question("push", place, still, way, 0.0, 2.0, "push", 1, 2.37),
        Question("which", (), (), (), 0.0, 0.0, "which", options=options),
    )
    record = record_of(structure).model_copy(update={"questions": asked})
    expand(record, tmp_path)
    read = questions_of(physment_mcp.open_episode(record.scene_id, 0, scenes_dir=tmp_path).prompt)
    assert [replace(one, kind="") for one in read] == [replace(one, kind="") for one in asked]


@pytest.mark.extended
def test_terms_are_found_and_predict() -> None:
    structure = Structure(Apparatus.WHEEL, (Term("dry friction"), Term("shaker", ("timid",))))
    constants, told = draw_constants(structure, random.Random(4)), told_of(structure)
    asked = questions(Apparatus.WHEEL)
    search = Search(Legs.of(simulated(structure, constants, told, 1), told), seconds=20.0)
    found = predicted(search, asked)
    key = answers(structure, constants, asked, 0.02)[:, 0]
    assert max(found.structures, key=lambda one: found.structures[one]) == structure
    assert (np.abs(found.answer - key) <= tolerance(key)).all()
    assert (found.low <= found.answer).all()
    assert (found.answer <= found.high).all()
    assert found.known
    assert "It explains the readings" in found.says()


@pytest.mark.parametrize("name", STRUCTURES)
def test_a_known_structure_is_fitted_with_nothing_known_of_its_constants(name: str) -> None:
    structure, told = STRUCTURES[name], told_of(STRUCTURES[name])
    constants, asked = draw_constants(structure, random.Random(8)), questions(structure.apparatus)
    course = simulated(structure, constants, told, 1)
    fit = on_course(course, told, Search(Legs.of(course, told)).solve(structure))
    key, found = (answers(structure, one, asked, 0.02)[:, 0] for one in (constants, constants_of(fit)))
    assert (np.abs(found - key) <= tolerance(key)).all()


def test_intervals_widen_with_the_assumed_error_of_the_readings() -> None:
    structure, told = STRUCTURES["pair"], told_of(STRUCTURES["pair"])
    course = simulated(structure, draw_constants(structure, random.Random(4)), told, 1)
    fit, asked = on_course(course, told, Search(Legs.of(course, told)).solve(structure)), questions(Apparatus.PAIR)
    spread, doubled = (plausible(fit, asked, 400, variance).std(axis=1) for variance in (1.0, 4.0))
    assert doubled == pytest.approx(2 * spread, rel=0.02)


def test_a_search_without_the_right_form_knows_that_it_does_not_know() -> None:
    structure = Structure(Apparatus.WHEEL, (Term("friction"), Term("shaker")))
    constants, told = draw_constants(structure, random.Random(4)), told_of(structure)
    search = Search(Legs.of(simulated(structure, constants, told, 1), told), seconds=8.0, forms=[FORMS["friction"]])
    found = predicted(search, questions(Apparatus.WHEEL))
    assert not found.known
    assert found.reduced > 3.5


def test_the_agent_plays_by_the_prompt_alone(tmp_path: Path) -> None:
    record = record_of(Structure(Apparatus.GLIDER, (Term("friction"),)), 12)
    expand(record, tmp_path)
    episode = physment_mcp.open_episode(record.scene_id, 0, scenes_dir=tmp_path)
    protocol = blind_protocol(episode.prompt, 10.0)
    calls = next(protocol)
    while all(call.tool != ANSWER for call in calls):
        calls = protocol.send([dict(episode.call(call.tool, **call.arguments)) for call in calls])
    answer = np.array(calls[0].arguments["answer"])
    key = answers(record.structure, record.constants, record.questions, 0.02)[:, 0]
    assert (np.abs(answer - key) <= tolerance(key)).all()


@pytest.mark.anyio
async def test_a_task_of_no_world_is_refused() -> None:
    with pytest.raises(WorldError, match="not one of a world"):
        situation_of("How heavy is the ball?")
    key = EpisodeKey(scene=7, seed=0, agent="grammar", budget=20)
    player = GrammarAgent().player(key, Briefing("How heavy is the ball?", (), 20, {}))
    with pytest.raises(AgentError, match="not one of a world"):
        await player.act(None)


@pytest.mark.anyio
async def test_the_event_loop_runs_while_the_agent_searches(monkeypatch: pytest.MonkeyPatch) -> None:
    allowed, replies = threading.Event(), list[Reply]()

    def searching(*_: object) -> Protocol:
        assert allowed.wait(10), "the event loop does not run"
        yield [call(ANSWER, answer=1.0)]

    monkeypatch.setattr("evaluator.agents.grammar.blind_protocol", searching)
    player = GrammarAgent().player(EpisodeKey(scene=7, seed=0, agent="grammar", budget=20), Briefing("", (), 20, {}))

    async def act() -> None:
        replies.append(await player.act(None))

    async with anyio.create_task_group() as group:
        group.start_soon(act)
        await anyio.lowlevel.checkpoint()
        allowed.set()
    assert [one.tool for one in replies[0].calls] == [ANSWER]


@pytest.mark.anyio
async def test_a_cancelled_agent_stops_its_search(monkeypatch: pytest.MonkeyPatch) -> None:
    begun, stopped = threading.Event(), threading.Event()

    def searching(_prompt: str, _seconds: float, _told: object, halted: threading.Event) -> Protocol:
        begun.set()
        if halted.wait(10):
            stopped.set()
        yield [call(ANSWER, answer=1.0)]

    monkeypatch.setattr("evaluator.agents.grammar.blind_protocol", searching)
    player = GrammarAgent().player(EpisodeKey(scene=7, seed=0, agent="grammar", budget=20), Briefing("", (), 20, {}))
    async with anyio.create_task_group() as group:
        group.start_soon(player.act, None)
        await anyio.to_thread.run_sync(begun.wait, 10)
        group.cancel_scope.cancel()
    assert await anyio.to_thread.run_sync(stopped.wait, 10)


def test_a_stopped_search_returns_what_it_has_found() -> None:
    structure = STRUCTURES["way"]
    told = told_of(structure)
    course = simulated(structure, draw_constants(structure, random.Random(4)), told, 1)
    search = Search(Legs.of(course, told))
    search.halted.set()
    assert search.over
    assert [fit.structure.terms for fit in search.run()] == [()]
