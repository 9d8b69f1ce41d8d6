"""Tests of presentations: the reference agent is right under each, and an agent gets the same readings under other
names.
"""

import json
import re
from dataclasses import dataclass, field
from itertools import combinations
from pathlib import Path

import pytest
from pydantic import JsonValue

from evaluator.agents.presentation import PARAPHRASES, Change, TranslatedAgent, Translation, parse_presentation
from evaluator.agents.reference import ReferenceAgent
from evaluator.answers.engine import prompt_of
from evaluator.answers.keys import KeyRing
from evaluator.certify.subject import Subject
from evaluator.certify.verify import MemoryConnector
from evaluator.commands.program import main
from evaluator.episode.loop import play_episode
from evaluator.episode.player import Agent, Briefing, Feedback, Player, Reply
from evaluator.errors import UsageError
from evaluator.records.episode import Episode, EpisodeKey, ToolCall, Verdict
from evaluator.scores.scoring import grade_record
from evaluator.store.run_folder import RunFolder
from scenes import find_pack
from tests.builders.records import VERSIONS, episode_key
from tests.harness.clients.playing import canonical, exchanges_of

SCENES = (7, 16, 21, 23, 58, 71, 104)
"""Scenes with one and several objects, numeric and object answers, and hidden, created and joined objects."""
SETS = [subset for size in (1, 3) for subset in combinations((Change.PARAPHRASE, Change.NAMES, Change.ORDER), size)]


@dataclass
class Overheard:
    """Wraps an agent and records its briefings, its feedback and its replies."""

    inner: Agent
    told: list[str] = field(default_factory=list[str])
    said: list[str] = field(default_factory=list[str])
    name: str = "overheard"

    def player(self, key: EpisodeKey, briefing: Briefing) -> Player:
        self.told.append(briefing.prompt)
        self.told.append(json.dumps([briefing.scene, *(tool.input_schema for tool in briefing.tools)]))
        inner = self.inner.player(key, briefing)
        overheard = self

        class Listening:
            async def act(self, feedback: Feedback | None) -> Reply:
                if feedback is not None:
                    shown = [(one.call.model_dump(), one.content, one.text) for one in feedback.exchanges]
                    overheard.told.append(json.dumps([shown, feedback.note], ensure_ascii=False))
                reply = await inner.act(feedback)
                overheard.said.append(json.dumps([call.model_dump() for call in reply.calls]))
                return reply

        return Listening()


async def played(agent: Agent, scene: int, seed: int = 1) -> Episode:
    memory = MemoryConnector()
    async with memory.open(scene, seed) as client:
        key = episode_key(scene, seed=seed, agent="reference")
        return await play_episode(agent, client, key, VERSIONS, memory.toolboxes)


@pytest.mark.parametrize("scene", [*SCENES[:-1], pytest.param(SCENES[-1], marks=pytest.mark.extended)])
async def test_the_reference_is_right_under_each_presentation_and_meets_the_same_readings(scene: int) -> None:
    usual = Overheard(ReferenceAgent())
    plain = await played(usual, scene)
    for presentation in SETS:
        met = Overheard(TranslatedAgent(ReferenceAgent(), Translation(presentation, inverse=True)))
        episode = await played(TranslatedAgent(met, Translation(presentation)), scene)
        assert episode.prompt == plain.prompt
        assert list(map(canonical, exchanges_of(episode))) == list(map(canonical, exchanges_of(plain)))
        assert grade_record(episode, KeyRing()).grade.strict is Verdict.CORRECT
        # The presented episode is exactly the translation of the ordinary one.
        several = usual.told[0].count("\n| object_") > 1
        assert (met.told != usual.told) is (several or presentation != (Change.ORDER,))
        assert [translated_back(text, presentation) for text in met.told] == [in_any_order(text) for text in usual.told]
        if Change.NAMES in presentation:
            assert not [text for text in (*met.told, *met.said) if "object_1" in text]


def translated_back(text: str, presentation: tuple[Change, ...]) -> list[str]:
    words = tuple(change for change in presentation if change is not Change.ORDER)
    return in_any_order(Translation(words, inverse=True).prompt(text))


def in_any_order(text: str) -> list[str]:
    """Return the words of a text, sorted, so that the order of listed objects does not matter."""
    return sorted(re.split(r"[\n ,\[\]{}]+", text))


def test_ids_are_exchanged_one_to_one() -> None:
    names = Translation((Change.NAMES,))
    ids = [f"object_{number}" for number in (*range(800), 999_999)]
    others = [names.text(one) for one in ids]
    assert others[:3] == ["sample_p", "sample_q", "sample_r"]
    assert len(set(others)) == len(ids)
    assert [names.text(other) for other in others] == ids
    # Text that names no object is unchanged: an id unknown to the laboratory, a field name, a part of a word.
    for text in ("object_01", "sample_a", "object_id", "my_object_1", "object_1000000", "sample_zzzzz"):
        assert names.text(text) == text


def test_the_names_of_a_law_are_those_of_its_objects() -> None:
    text = "object_1_push_x - 0.4*(object_1_vx - object_12_vx)"
    law: dict[str, JsonValue] = {"acceleration": {"object_1": {"x": text}}}
    there, back = Translation((Change.NAMES,)), Translation((Change.NAMES,), inverse=True)
    told = there.value(law)
    assert told == {"acceleration": {"sample_q": {"x": "sample_q_push_x - 0.4*(sample_q_vx - sample_ab_vx)"}}}
    sent = back.reply(Reply(calls=(ToolCall(tool="answer", arguments={"answer": 1, "law": told}),)))
    assert sent.calls[0].arguments["law"] == law


def test_an_agent_that_guesses_the_usual_ids_finds_nothing() -> None:
    names = Translation((Change.NAMES,), inverse=True)
    asked = names.reply(Reply(calls=(ToolCall(tool="get_position", arguments={"object_id": "object_1"}),)))
    assert asked.calls[0].arguments == {"object_id": "sample_q"}


def test_lists_of_objects_are_reversed_and_lists_of_numbers_are_not() -> None:
    order = Translation((Change.ORDER,))
    result: JsonValue = {"revealed": [{"object_id": "object_2"}, {"object_id": "object_3"}], "position": [1, 2, 3]}
    assert order.value(result) == {
        "revealed": [{"object_id": "object_3"}, {"object_id": "object_2"}],
        "position": [1, 2, 3],
    }
    prompt = "# Objects\n\n| id | name |\n|---|---|\n| object_1 | a |\n| object_2 | b |\n\n| x |\n|---|\n| 1 |\n| 2 |\n"
    assert "| object_2 | b |\n| object_1 | a |\n" in order.prompt(prompt)
    assert "| 1 |\n| 2 |\n" in order.prompt(prompt)
    assert order.prompt(order.prompt(prompt)) == prompt


def test_each_paraphrased_sentence_is_one_of_the_laboratory_and_no_paraphrase_is() -> None:
    prompts = "".join(map(prompt_with_budget, (7, 80)))
    for sentence, paraphrase in PARAPHRASES:
        assert sentence in prompts
        assert paraphrase not in prompts


def prompt_with_budget(scene: int) -> str:
    files = find_pack(scene)
    return prompt_of(files, Subject.open(files).draw(0).mjcf, budget=20)


def test_a_run_records_its_presentation_and_compare_names_it(
    tmp_path: Path, host_url: str, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["run", "--server", host_url, "--scenes", "7,104", "--agent", "reference", "--out"]
    assert main([*words, str(tmp_path / "plain")]) == 0
    assert main([*words, str(tmp_path / "other"), "--presentation", "order,names"]) == 0
    record = RunFolder(tmp_path / "other").read_run()
    assert record.plan.presentation == ("names", "order")
    assert "presentation" not in json.loads((tmp_path / "plain" / "run.json").read_text(encoding="utf-8"))["plan"]
    assert "names, order" in (tmp_path / "other" / "report.html").read_text(encoding="utf-8")
    assert main([*words, str(tmp_path / "other"), "--resume"]) == 2
    assert main([*words, str(tmp_path / "third"), "--presentation", "colours"]) == 2
    assert "--presentation colours: the changes are paraphrase, names, order, units" in capsys.readouterr().err
    assert main(["compare", str(tmp_path / "plain"), str(tmp_path / "other")]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert (
        "reference (presentation names, order) (B) and reference (as presented) (A) cannot be told apart on 2 common"
        in said
    )
    program = ["run", "--server", host_url, "--agent", "external", "--presentation", "names", "--", "true"]
    assert main(program) == 2
    assert "an external agent speaks with the laboratory itself" in capsys.readouterr().err


def test_several_changes_are_read_once_each_in_their_order() -> None:
    assert parse_presentation("order, paraphrase,order") == (Change.PARAPHRASE, Change.ORDER)
    assert parse_presentation("") == ()
    with pytest.raises(UsageError, match="--presentation x"):
        parse_presentation("names,x")
