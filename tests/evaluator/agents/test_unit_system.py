"""Tests of `--presentation units`: every number of every tool is converted, and the physics is the same."""

import json
import re
from typing import Any

import pytest
from pydantic import JsonValue

from evaluator.agents.presentation import Change, TranslatedAgent, Translation
from evaluator.agents.reference import ReferenceAgent
from evaluator.agents.unit_system import (
    LAW_UNITS,
    SENTENCES,
    UNITS,
    described_units,
    exchanged,
    exchanged_schema,
    unit_of,
)
from evaluator.answers.keys import KeyRing
from evaluator.episode.player import Feedback, Reply
from evaluator.records.episode import Exchange, ToolCall, Verdict
from evaluator.scores.scoring import grade_record
from physment_mcp.tools.episode import ANSWER_WITH_LAW
from tests.builders.paths import ROOT
from tests.evaluator.agents.test_presentation import SCENES, Overheard, played, prompt_with_budget

TOOLS: list[dict[str, Any]] = json.loads(
    (ROOT / "tests" / "physment_mcp" / "tools" / "tools.golden.json").read_text(encoding="utf-8")
)
WITHOUT_UNIT = {"m g z", "x, y, z", "w, x, y, z", "rad", "red, green, blue, opacity", "0, 0, 0"}


def described_fields() -> list[tuple[str, str, str]]:
    """Return each argument and result field whose description states a unit in brackets: tool, name, description."""
    return [
        (tool["name"], name, part["description"])
        for tool in TOOLS
        for schema in (tool["inputSchema"], tool["outputSchema"])
        for name, part in schema.get("properties", {}).items()
        if "[" in part.get("description", "")
    ]


@pytest.mark.parametrize(("tool", "name", "description"), described_fields())
def test_the_table_has_the_unit_of_each_argument_and_field(tool: str, name: str, description: str) -> None:
    stated = [unit for unit in re.findall(r"\[([^\]]+)\]", description) if unit not in WITHOUT_UNIT]
    if name == "revealed":
        pairs = re.findall(r"(\w+)(?: \([^)]*\))? \[([^\]]+)\]", description)
        assert [unit_of(tool, field) for field, unit in pairs if unit in UNITS] == [u for _, u in pairs if u in UNITS]
        assert {unit for _, unit in pairs} - set(UNITS) <= WITHOUT_UNIT
    else:
        assert stated == ([] if unit_of(tool, name) is None else [unit_of(tool, name)])


def test_factors_follow_from_the_three_base_units() -> None:
    base = {"m": 1e2, "kg": 1e3, "s": 1e3, "rad": 1.0}
    base |= {"N": base["kg"] * base["m"] / base["s"] ** 2}
    base |= {"J": base["N"] * base["m"], "cm": 1.0, "g": 1.0, "ms": 1.0}
    powers = str.maketrans("²³", "23")

    def size(unit: str) -> float:
        over, _, under = unit.translate(powers).partition("/")
        product = 1.0
        for text, sign in ((over, 1), (under, -1)):
            for factor in text.split("·") if text else ():
                name, power = re.fullmatch(r"(\D+)(\d?)", factor).groups()  # pyright: ignore[reportOptionalMemberAccess]
                product *= base[name] ** (sign * int(power or 1))
        return product

    for unit, (other, factor) in UNITS.items():
        assert size(unit) == pytest.approx(factor)
        assert size(other) == 1.0


@pytest.mark.parametrize("scene", [*SCENES, pytest.param(28, marks=pytest.mark.extended)])
async def test_the_reference_is_right_and_makes_the_same_experiment_in_other_units(scene: int) -> None:
    plain = await played(ReferenceAgent(), scene)
    met = Overheard(TranslatedAgent(ReferenceAgent(), Translation((Change.UNITS,), inverse=True)))
    episode = await played(TranslatedAgent(met, Translation((Change.UNITS,))), scene)
    assert episode.prompt == plain.prompt
    assert "centimetres" in met.told[0]
    assert grade_record(episode, KeyRing()).grade.strict is Verdict.CORRECT
    usual = [one.call.tool for turn in plain.turns for one in turn.exchanges]
    assert [one.call.tool for turn in episode.turns for one in turn.exchanges] == usual


def test_an_agent_meets_centimetres_and_the_laboratory_metres() -> None:
    units, back = Translation((Change.UNITS,)), Translation((Change.UNITS,), inverse=True)
    call = ToolCall(tool="get_velocity", arguments={"object_id": "object_1"})
    content: dict[str, JsonValue] = {"sim_time": 0.3, "velocity": [1, -2.5, 0], "angular_velocity": None}
    exchange = Exchange(call=call, returned=True, content=content, text=json.dumps(content))
    shown = units.feedback(Feedback((exchange,), "", 3)).exchanges[0]
    assert shown.content == {"sim_time": 300.0, "velocity": [0.1, -0.25, 0.0], "angular_velocity": None}
    assert json.loads(shown.text) == shown.content
    pushed = ToolCall(tool="apply_force", arguments={"object_id": "object_1", "force_vector": [0.2, 0, -1]})
    assert back.reply(Reply(calls=(pushed,))).calls[0].arguments["force_vector"] == [2.0, 0.0, -10.0]


def test_what_is_no_number_stays_and_so_does_a_refusal() -> None:
    assert exchanged("step", {"duration": "long", "other": 3}, inverse=True) == {"duration": "long", "other": 3}
    assert exchanged("create_objects", {"pos": [True, 1]}, inverse=True) == {"pos": [True, 0.01]}
    assert exchanged("step", {"duration": 10**400}, inverse=True) == {"duration": 10**400}
    refused = Exchange(call=ToolCall(tool="step", arguments={}), returned=True, is_error=True, text="at most 60 s")
    shown = Translation((Change.UNITS,)).feedback(Feedback((refused,), "", 1)).exchanges[0]
    assert shown.text == "at most 60 s"


def test_bounds_and_descriptions_of_arguments_follow() -> None:
    step = next(tool for tool in TOOLS if tool["name"] == "step")
    schema = exchanged_schema("step", step["inputSchema"], inverse=False)
    assert schema["properties"]["duration"]["maximum"] == 60_000
    assert "[ms]" in schema["properties"]["duration"]["description"]
    assert exchanged_schema("step", schema, inverse=True) == step["inputSchema"]
    assert described_units("Force [x, y, z], world [N].", inverse=False) == "Force [x, y, z], world [g·cm/ms²]."


@pytest.mark.parametrize(("scene", "sentences"), [(7, SENTENCES[:1]), (201, SENTENCES)])
def test_the_sentences_about_units_are_those_of_the_laboratory(
    scene: int, sentences: tuple[tuple[str, str], ...]
) -> None:
    prompt = prompt_with_budget(scene)
    assert [prompt.count(sentence) for sentence, _ in SENTENCES] == [pair in sentences for pair in SENTENCES]
    changed = Translation((Change.UNITS,)).prompt(prompt)
    assert Translation((Change.UNITS,), inverse=True).prompt(changed) == prompt
    both = Translation((Change.PARAPHRASE, Change.UNITS)).prompt(prompt)
    assert all(other in both for _, other in sentences)
    assert "All quantities are in SI units" not in both
    assert Translation((Change.PARAPHRASE, Change.UNITS), inverse=True).prompt(both) == prompt


def test_the_description_of_a_law_says_that_it_alone_stays_in_si_units() -> None:
    schema = ANSWER_WITH_LAW.arguments.model_json_schema()
    assert schema["properties"]["law"]["description"].count(LAW_UNITS[0]) == 1
    changed = exchanged_schema("answer", schema, inverse=False)
    assert LAW_UNITS[1] in changed["properties"]["law"]["description"]
    assert exchanged_schema("answer", changed, inverse=True) == schema
    law: JsonValue = {"acceleration": {"object_1": {"x": "-0.5*object_1_vx"}}, "state": {"way": {"start": 1}}}
    sent = Reply(calls=(ToolCall(tool="answer", arguments={"answer": 1, "law": law}),))
    assert Translation((Change.UNITS,), inverse=True).reply(sent) == sent
