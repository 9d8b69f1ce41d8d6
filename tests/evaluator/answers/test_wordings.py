"""Answers in words: the wordings of the observation scenes, on lists of right and wrong ones.

One list was drafted together with the rules; all of it must be graded right. The other was written from the tasks
alone, without sight of the rules, which got 16 of its 720 judgements wrong and were then mended. What they still get
wrong is named.
"""

import json
from pathlib import Path
from typing import Any

import pytest

from evaluator.answers.grading import grade
from evaluator.answers.strict import AnswerKey
from evaluator.answers.wordings import first_wording
from evaluator.records import Verdict
from scenes import AnswerKind, AnswerSpec, find_pack, read_pack
from scenes.answer_spec import Wording

FOLDER = Path(__file__).parent / "wordings"
OBSERVATIONS = (15, 57, 70)
MISTAKEN = {
    ("57", "both blocks move together", "The small block does not lag behind."),
    ("70", "its left end sinks", "It sinks if the cup is left of the axis."),
    ("70", "it stays level", "It possibly rises or stays level."),
}
"""Scene, key and answer of what the rules get wrong of the second list: all three are taken for right and are not."""


def lists_of(name: str) -> dict[str, Any]:
    return json.loads((FOLDER / f"{name}.json").read_text(encoding="utf-8"))


def spec_of(scene: int) -> AnswerSpec:
    spec = read_pack(find_pack(scene)).answer_spec
    assert spec is not None
    return spec


def mistakes(lists: dict[str, Any]) -> set[tuple[str, str, str]]:
    found: set[tuple[str, str, str]] = set()
    for scene, said in lists.items():
        spec = spec_of(int(scene))
        for key in spec.wordings:
            answers = [(text, meant == key) for meant, texts in said["right"].items() for text in texts]
            for text, is_right in [*answers, *((text, False) for text in said["wrong"])]:
                if (grade(text, AnswerKey(key, spec)).strict is Verdict.CORRECT) is not is_right:
                    found.add((scene, key, text))
    return found


def test_every_wording_drafted_with_the_rules_is_graded_right() -> None:
    lists = lists_of("drafted_with_the_rules")
    assert set(lists) == {str(scene) for scene in OBSERVATIONS}
    for said in lists.values():
        assert sum(map(len, said["right"].values())) >= 30
        assert len(said["wrong"]) >= 30
    assert mistakes(lists) == set()


def test_wordings_written_without_sight_of_the_rules() -> None:
    assert mistakes(lists_of("written_without_the_rules")) == MISTAKEN


@pytest.mark.parametrize("scene", OBSERVATIONS)
def test_the_observation_scenes_ask_for_words(scene: int) -> None:
    pack = read_pack(find_pack(scene))
    assert pack.metadata.problem_type == "observation"
    assert pack.answer_spec is not None
    assert pack.answer_spec.kind is AnswerKind.TEXT
    assert len(pack.answer_spec.wordings) == 3


def text_key(**wording: tuple[str, ...]) -> AnswerKey:
    spec = AnswerSpec(kind=AnswerKind.TEXT, wordings={"the lamp goes out": (Wording(**wording),)})
    return AnswerKey("the lamp goes out", spec)


@pytest.mark.parametrize(
    ("answer", "is_right"),
    [
        ("the lamp goes out", True),
        ("The light  is\nswitched OFF", True),
        ("it's off", True),
        ("the lamp doesn’t go off", False),
        ("the lamp does not go off", False),
        ("lamp", False),  # words of the key alone are not enough where the pack gives wordings
        ("", False),
        ("off" + " really" * 60, False),  # longer than a sentence
        (["off", "on"], False),
        (7, False),
    ],
)
def test_a_wording_fits_by_what_it_says_and_does_not_say(answer: Any, is_right: bool) -> None:
    found = grade(answer, text_key(says=(r"\boff\b",), never=(r"\bnot\b",)))
    assert (found.strict is Verdict.CORRECT) is is_right


def test_an_answer_right_for_another_draw_is_wrong() -> None:
    spec = AnswerSpec(
        kind=AnswerKind.TEXT, wordings={"on": (Wording(says=("lit",)),), "off": (Wording(says=("dark",)),)}
    )
    assert grade("it is dark", AnswerKey("off", spec)).strict is Verdict.CORRECT
    assert grade("it is dark", AnswerKey("on", spec)).strict is Verdict.INCORRECT


@pytest.mark.parametrize(
    ("written", "read"), [("it can't", "it can not"), ("it won’t", "it will not"), ("cannot", "can not")]
)
def test_negations_are_written_out(written: str, read: str) -> None:
    assert first_wording(written, [Wording(says=(f"^{read}$",))]) is not None


def test_a_wording_that_cannot_be_read_is_no_key() -> None:
    with pytest.raises(ValueError, match=r"the pattern '\(' cannot be read"):
        text_key(says=("off",), never=("(",))
