"""Tests that secrets are redacted in all their encodings, and that other text is unchanged."""

import base64
import json
from pathlib import Path
from urllib.parse import quote

import pytest

from evaluator.records.episode import Outcome
from evaluator.store.redaction import Redaction
from evaluator.store.run_folder import RunFolder
from tests.builders.records import call, episode, returned, turn

KEY = 'sk-"ä/+ secret=1?'
ENVIRONMENT = {"MODEL_API_KEY": KEY, "HOME": "/home/you", "SHORT_KEY": "1234567"}
CLEAN = Redaction.of(ENVIRONMENT, {"host token": "abcdefghij"})


@pytest.mark.parametrize(
    "form",
    [
        KEY,
        json.dumps(KEY)[1:-1],
        json.dumps(KEY, ensure_ascii=False)[1:-1],
        quote(KEY),
        quote(KEY, safe=""),
    ],
)
def test_each_form_of_a_secret_is_replaced_by_its_name(form: str) -> None:
    assert CLEAN.text(f"before {form} after {form}") == "before [MODEL_API_KEY] after [MODEL_API_KEY]"


@pytest.mark.parametrize("before", range(7))
@pytest.mark.parametrize("after", range(4))
def test_a_secret_inside_base64_is_replaced_wherever_it_stands(before: int, after: int) -> None:
    whole = b"x" * before + KEY.encode() + b"y" * after
    for encode in (base64.b64encode, base64.urlsafe_b64encode):
        cleaned = CLEAN.text(encode(whole).decode())
        assert "[MODEL_API_KEY]" in cleaned
        kept = cleaned.replace("[MODEL_API_KEY]", "")
        assert len(kept) <= len(encode(b"x" * before + b"y" * after)) + 8


def test_ordinary_text_short_values_and_other_variables_are_left_alone() -> None:
    text = "a home in /home/you, 1234567, MODEL_API_KEY, sk-"
    assert CLEAN.text(text) == text
    record = episode(turn(text))
    assert CLEAN.record(record) is record
    assert Redaction().record(record) is record


def test_a_longer_secret_is_replaced_before_one_that_it_contains() -> None:
    clean = Redaction.of({"A_TOKEN": "sk-12345678", "B_TOKEN": "sk-12345678-9"})
    assert clean.text("sk-12345678-9 and sk-12345678") == "[B_TOKEN] and [A_TOKEN]"


def test_no_secret_reaches_a_stored_episode(tmp_path: Path) -> None:
    folder = RunFolder(tmp_path / "run", redaction=CLEAN)
    folder.create(resume=False)
    said = episode(
        turn(f"My key is {KEY}.", returned("step", {"sim_time": 1.0}, duration=1.0)),
        turn("", returned("answer", answer=[KEY, 3])),
        answer=[KEY, 3],
        prompt="abcdefghij",
    )
    failed = episode(
        turn(base64.b64encode(KEY.encode()).decode()),
        outcome=Outcome.AGENT_ERROR,
        error=f"401 for {KEY}",
    )
    assert call("answer", answer=KEY).arguments["answer"] == KEY
    folder.append_episode(said)
    folder.append_episode(failed.model_copy(update={"key": failed.key.model_copy(update={"seed": 1})}))
    text = (tmp_path / "run" / "episodes.jsonl").read_text(encoding="utf-8")
    assert "sk-" not in text
    assert "abcdefghij" not in text
    first, second = folder.episodes().values()
    assert first.turns[0].reasoning == "My key is [MODEL_API_KEY]."
    assert first.turns[0].exchanges == said.turns[0].exchanges
    assert first.answer == ["[MODEL_API_KEY]", 3]
    assert second.error == "401 for [MODEL_API_KEY]"
