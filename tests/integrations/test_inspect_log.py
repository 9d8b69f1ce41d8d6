# The optional library is not in the environment in which types are checked.
# pyright: reportMissingImports=false
"""Tests that Inspect AI's reader opens the exported logs and finds the content of the records."""

from typing import Any

import pytest

inspect_ai = pytest.importorskip(
    "inspect_ai", reason="inspect_ai is not installed; `python -m tests.harness.frameworks inspect` runs this"
)

from evaluator.commands.program import main  # noqa: E402 - after the check that the library is there
from evaluator.records.episode import Verdict  # noqa: E402 - as above
from evaluator.store.run_folder import RunFolder  # noqa: E402 - as above

pytestmark = pytest.mark.filterwarnings("default")  # warnings of a library with a hundred dependencies


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> tuple[RunFolder, list[Any]]:
    from inspect_ai.log import read_eval_log

    folder = tmp_path_factory.mktemp("logs") / "run"
    agents = ["--agent", "reference", "--agent", "random"]
    options = ["--scenes", "7,8", "--seeds", "0,3", "--epochs", "2", "--budgets", "6", "--server", "host"]
    assert main(["run", *agents, *options, "--out", str(folder)]) == 0
    assert main(["export", str(folder), "--to", "inspect"]) == 0
    return RunFolder(folder), [read_eval_log(str(file)) for file in sorted((folder / "inspect").iterdir())]


def test_each_condition_has_a_log_with_every_episode(logs: tuple[RunFolder, list[Any]]) -> None:
    folder, read = logs
    assert {log.eval.model for log in read} == {"reference", "random"}
    for log in read:
        assert log.status == "success"
        assert log.eval.config.epochs == 2
        keys = [key for key in folder.episodes() if key.agent == log.eval.model]
        ids = {(sample.id, sample.epoch) for sample in log.samples}
        assert ids == {(f"scene{key.scene}-seed{key.seed}", key.epoch) for key in keys}
        assert len(log.samples) == len(keys) == log.results.completed_samples


def test_scores_and_conversations_are_those_of_the_records(logs: tuple[RunFolder, list[Any]]) -> None:
    folder, read = logs
    grades = folder.grades()
    for log in read:
        episodes = [episode for key, episode in folder.episodes().items() if key.agent == log.eval.model]
        stored = {(f"scene{one.key.scene}-seed{one.key.seed}", one.key.epoch): one for one in episodes}
        for sample in log.samples:
            episode = stored[sample.id, sample.epoch]
            grade = grades[episode.key].grade
            score = sample.scores["laboratory_grade"]
            assert score.value["strict"] == float(grade.strict is Verdict.CORRECT)
            assert score.explanation == grade.reason
            exchanges = [exchange for turn in episode.turns for exchange in turn.exchanges]
            called = [call for one in sample.messages if one.role == "assistant" for call in one.tool_calls or []]
            assert [(call.function, call.arguments) for call in called] == [
                (exchange.call.tool, exchange.call.arguments) for exchange in exchanges
            ]
            told = [message.text for message in sample.messages if message.role == "tool" and message.text]
            assert [exchange.text for exchange in exchanges if exchange.returned and exchange.text] == [
                text for text in told if not text.startswith("Not run.")
            ]
            assert sample.messages[0].text == episode.prompt
        right = [grades[episode.key].grade.strict is Verdict.CORRECT for episode in episodes]
        [strict] = [score for score in log.results.scores if score.name == "strict"]
        assert strict.metrics["mean"].value == pytest.approx(sum(right) / len(right))


def test_analysis_functions_read_the_logs_as_data(logs: tuple[RunFolder, list[Any]]) -> None:
    from inspect_ai.log import list_eval_logs, read_eval_log_samples

    folder, read = logs
    found = list_eval_logs(str(folder.path / "inspect"))
    assert len(found) == len(read) == 2
    assert sum(1 for log in found for _ in read_eval_log_samples(log)) == len(folder.episodes())
