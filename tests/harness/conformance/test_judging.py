"""The comparison of the conformance suite's results with the list of expected failures."""

import json
import os
from pathlib import Path

import pytest

from tests.harness.conformance.judging import Expected, differences, page, read_expected
from tests.harness.conformance.suite import CannotRun, Result, read_results, run_suite

HERE = Path(__file__).parent
LISTED = {
    "image": Expected(scenario="image", kind="fixture", checks=frozenset({"has-image"}), reason="tool `test_image`.")
}
GOOD = Result(2, frozenset())
BAD = Result(1, frozenset({"has-image"}))


def test_a_listed_failure_is_no_difference() -> None:
    assert differences({"2025": {"ping": GOOD, "image": BAD}, "2026": {"ping": GOOD}}, LISTED) == []


@pytest.mark.parametrize(
    ("results", "sentence"),
    [
        ({"image": BAD, "ping": Result(0, frozenset({"pong"}))}, "2025 ping: pong fails and is not in the list"),
        (
            {"image": Result(1, frozenset({"has-image", "wire"}))},
            "2025 image: wire fails and is not in the list",
        ),
        ({"image": GOOD}, "2025 image: has-image does not fail any more; take it from the list"),
        ({"ping": GOOD}, "image: in the list, but there is no such scenario"),
        ({"image": BAD, "ping": Result(0, frozenset())}, "2025 ping: nothing was checked"),
    ],
)
def test_each_difference_is_reported(results: dict[str, Result], sentence: str) -> None:
    assert differences({"2025": results}, LISTED) == [sentence]


def test_the_results_of_the_suite_are_parsed(tmp_path: Path) -> None:
    folder = tmp_path / "server-server-stateless-2026-11-21T09-59-47-618Z"
    folder.mkdir()
    statuses = {"a": "SUCCESS", "b": "FAILURE", "c": "WARNING", "d": "SKIPPED", "e": "INFO"}
    checks = [{"id": name, "status": status} for name, status in statuses.items()]
    (folder / "checks.json").write_text(json.dumps(checks), encoding="utf-8")
    assert read_results(tmp_path) == {"server-stateless": Result(1, frozenset({"b"}))}


@pytest.mark.parametrize(
    ("program", "sentence"),
    [
        ("echo 'npm error 404' >&2; exit 1", "did not start: npm error 404"),
        ("echo 'Running all suite (3 scenarios) against x'", "announced 3 scenarios for 2025-11-25 and reported 0"),
    ],
)
def test_a_suite_that_stops_early_is_an_error(
    program: str, sentence: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    npx = tmp_path / "npx"
    npx.write_text(f"#!/bin/sh\n{program}\n", encoding="utf-8")
    npx.chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}{os.pathsep}{os.environ['PATH']}")
    with pytest.raises(CannotRun, match=sentence):
        run_suite("http://127.0.0.1:1/mcp", "2025-11-25")


def test_a_missing_npx_is_reported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(CannotRun, match="npx is not installed"):
        run_suite("http://127.0.0.1:1/mcp", "2025-11-25")


def test_the_page_lists_every_scenario() -> None:
    text = page({"2025": {"ping": GOOD, "image": BAD}, "2026": {"ping": GOOD}}, LISTED, "suite@1")
    assert "1 of 2 in 2025, 1 of 1 in 2026" in text
    assert "| ping | yes (2) | yes (2) |  |" in text
    assert "| image | no (1 of 2) | – | *fixture*: tool `test_image`. |" in text


def test_the_list_and_the_page_agree() -> None:
    """Compares the page of results with the list of scenarios. Writing the page anew would need the network."""
    text = (HERE.parents[2] / "docs" / "explanation" / "conformance.md").read_text(encoding="utf-8")
    for entry in read_expected(HERE / "expected.toml").values():
        assert f"| {entry.scenario} |" in text
        assert f"| *{entry.kind}*: {entry.reason} |" in text


def test_a_scenario_listed_twice_is_refused(tmp_path: Path) -> None:
    entry = '[[expected]]\nscenario = "ping"\nkind = "fault"\nchecks = ["pong"]\nreason = "it is not answered"\n'
    (tmp_path / "expected.toml").write_text(entry * 2, encoding="utf-8")
    with pytest.raises(ValueError, match="named twice: ping"):
        read_expected(tmp_path / "expected.toml")
