"""The page of a run: true to its records, self-contained, and safe whatever an agent wrote."""

import re
from html.parser import HTMLParser

from evaluator.metrics import ScoredEpisode
from evaluator.records import (
    Episode,
    EpisodeKey,
    Exchange,
    Grade,
    GradeRecord,
    Outcome,
    ToolCall,
    Turn,
    Verdict,
    Versions,
)
from evaluator.report.page import render

EVIL = "</pre><script>alert('x')</script><img src=x onerror=alert(1)> {{ 7*7 }}"
FACTS = {
    "plan": {"agent": f"agent {EVIL}", "scenes": [7, 21], "budgets": [5]},
    "server": {"option": "stdio"},
    "created_at": "2026-01-01T00:00:00+00:00",
}


def row(scene: int, verdict: Verdict, category: str, said: str = "I look.") -> ScoredEpisode:
    call = ToolCall(tool="step", arguments={"duration": 0.1, "note": said})
    turn = Turn(reasoning=said, exchanges=(Exchange(call=call, returned=True, is_error=True, text=said),), note=said)
    unplayed = verdict is Verdict.UNSCORED
    episode = Episode(
        key=EpisodeKey(scene=scene, seed=0, agent="x", budget=5),
        outcome=Outcome.INFRASTRUCTURE_ERROR if unplayed else Outcome.ANSWERED,
        answer=None if unplayed else said,
        prompt=said,
        turns=() if unplayed else (turn,),
        error=said if unplayed else None,
        started_at="2026-01-01T00:00:00+00:00",
        duration_s=1.0,
        versions=Versions(physment="0", protocol="0", pack="0"),
    )
    grade = Grade(
        strict=verdict, graded=None if unplayed else float(verdict is Verdict.CORRECT), normalised=verdict, reason=said
    )
    return ScoredEpisode(episode, grade, category, "calculation")


def page(*rows: ScoredEpisode) -> str:
    records = {
        one.episode.key: GradeRecord(
            key=one.episode.key, grade=one.grade, answer_key=1.5, grader_version="1", pack_version="0"
        )
        for one in rows
    }
    return render(FACTS, rows, records)


class _Tags(HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.seen: list[tuple[str, dict[str, str | None]]] = []
        self.open: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.seen.append((tag, dict(attrs)))
        if tag not in {"meta", "input", "br"}:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


def tags(text: str) -> _Tags:
    parser = _Tags()
    parser.feed(text)
    return parser


def test_nothing_an_agent_wrote_becomes_markup() -> None:
    text = page(row(7, Verdict.CORRECT, "easy-single", EVIL), row(21, Verdict.UNSCORED, "hard-single", EVIL))
    parsed = tags(text)
    assert parsed.open == []
    assert [tag for tag, _ in parsed.seen if tag == "script"] == ["script"]
    assert not [tag for tag, _ in parsed.seen if tag == "img"]
    assert "&lt;script&gt;alert" in text
    assert "{{ 7*7 }}" in text


def test_the_page_needs_nothing_from_elsewhere() -> None:
    text = page(row(7, Verdict.CORRECT, "easy-single"))
    assert not re.search(r"https?://|//cdn|@import|url\(", text)
    assert not [tag for tag, attributes in tags(text).seen if tag == "link" or attributes.get("src")]


def test_the_numbers_are_those_of_the_records() -> None:
    text = page(
        row(7, Verdict.CORRECT, "easy-single"),
        row(16, Verdict.INCORRECT, "easy-single-creation"),
        row(21, Verdict.UNSCORED, "easy-single-hidden"),
    )
    assert "1 of 2; 95 % interval 9.5 % to 90.5 %" in text
    assert text.count('data-verdict="correct"') == text.count('data-verdict="incorrect"') == 1
    assert text.count('data-verdict="unscored"') == 1
    assert "Infrastructure error" in text


def test_tables_and_controls_have_names_for_those_who_cannot_see_them() -> None:
    parsed = tags(page(row(7, Verdict.CORRECT, "easy-single")))
    names = [tag for tag, _ in parsed.seen]
    assert names.count("caption") == names.count("table")
    assert all(attributes.get("scope") in {"row", "col"} for tag, attributes in parsed.seen if tag == "th")
    assert [attributes for tag, attributes in parsed.seen if tag == "html"] == [{"lang": "en"}]
    assert "main" in names
    assert "h1" in names
