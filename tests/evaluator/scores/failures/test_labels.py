"""Compares the failure detectors and the links of numbers with manual labels of the authors' published logs.

`labels.json` contains only ids and labels. For an episode: agent, scene, epoch, the stratum of the sample, and the
failure modes that a reader saw. For a number: agent, scene, epoch, turn, position, and whether it was read from a
result. The logs and packs are not in this repository; PHYSMENT_ORIGINAL names the folder that contains them.
"""

import json
import re
from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path
from statistics import fmean
from typing import NamedTuple

import pytest

from evaluator.answers.grading import grade_episode
from evaluator.answers.keys import KeyRing
from evaluator.original.logs import as_logged, find_logs
from evaluator.original.play import scene_of
from evaluator.records.episode import Episode, Grade, Verdict
from evaluator.report.export import markdown_table
from evaluator.scores.dimensions import EpisodeScores
from evaluator.scores.failures.detect import failures_of
from evaluator.scores.failures.findings import FailureMode, expected_form
from evaluator.scores.grounding import grounding_of
from evaluator.scores.metrics import held_out_accuracy
from evaluator.statistics.intervals import wilson_interval
from evaluator.study.selection import parse_scenes
from scenes import read_pack
from tests.builders.paths import DOCS, ORIGINAL
from tests.builders.records import VERSIONS, episode_key
from tests.builders.scored import scored, scores_of

HERE = Path(__file__)
DOC = DOCS / "explanation" / "failure-modes.md"
BEGIN, END = "<!-- measured -->\n", "<!-- end -->\n"
LABELS = json.loads(HERE.with_name("labels.json").read_text(encoding="utf-8"))
SAMPLES = ("first", "second", "third", "fourth")
PUBLISHED = [
    ("E", "0.655", "0.418", "0.201"),
    ("G", "0.544", "0.514", "0.702"),
    ("V", "0.999", "1.000", "0.999"),
    ("R", "0.613", "0.633", "0.708"),
    ("G′", "0.580", "0.588", "0.381"),
]
"""The paper's table of dimensions, for the models of the logs, in the order of their names."""

Id = tuple[str, int, int]
"""Agent, scene, epoch."""


class Judged(NamedTuple):
    """A logged episode, its grade and scores, and the modes that the detectors found."""

    episode: Episode
    grade: Grade
    scores: EpisodeScores
    found: frozenset[str]


class Agreement(NamedTuple):
    """Counts of agreement between detected and labelled modes."""

    both: int
    found_only: int
    labelled_only: int

    @property
    def precision(self) -> float | None:
        found = self.both + self.found_only
        return self.both / found if found else None

    @property
    def recall(self) -> float | None:
        labelled = self.both + self.labelled_only
        return self.both / labelled if labelled else None


@pytest.fixture(scope="module")
def judged() -> dict[Id, Judged]:
    """All logged episodes."""
    packs = ORIGINAL / "Scenes"
    names = {files.scene_id: read_pack(files).metadata.scene_name for files in parse_scenes(None, packs)}
    keys, epochs = KeyRing(packs), Counter[Id]()
    rows: dict[Id, Judged] = {}
    for log in find_logs(ORIGINAL / "logs"):
        scene = scene_of(log, names)
        if scene is None or not log.replies:
            continue
        epochs[log.model, log.budget, scene] += 1
        key = episode_key(
            scene,
            agent=log.model,
            budget=max(log.budget, len(log.replies)),
            epoch=epochs[log.model, log.budget, scene],
        )
        episode = as_logged(log, key, VERSIONS)
        answer_key = keys.key(scene, 0)
        grade, form = grade_episode(episode, answer_key), expected_form(answer_key, keys.facts(scene).task)
        found = frozenset(failure.mode.value for failure in failures_of(episode, grade, form))
        rows[key.agent, scene, key.epoch] = Judged(episode, grade, scores_of(episode, grade), found)
    return rows


def agreement(judged: dict[Id, Judged], sample: Iterable[Sequence[object]], mode: FailureMode) -> Agreement:
    pairs = Counter((mode in judged[_id(row)].found, mode in row[4]) for row in sample)  # type: ignore[operator]
    return Agreement(pairs[True, True], pairs[True, False], pairs[False, True])


def link_agreement(judged: dict[Id, Judged]) -> tuple[Agreement, Counter[tuple[str, str]]]:
    """Agreement of links with labels, and how often each label is `linked`, `unsupported` or `left out`."""
    treated: Counter[tuple[str, str]] = Counter()
    for row in LABELS["numbers"]:
        assertions = grounding_of(judged[_id(row)].episode).assertions
        found = next((said for said in assertions if (said.turn, said.start) == (row[3], row[4])), None)
        treated[row[5], "left out" if found is None else "linked" if found.support else "unsupported"] += 1
    linked = sum(count for (_, how), count in treated.items() if how == "linked")
    right = treated["read", "linked"]
    read = sum(count for (label, _), count in treated.items() if label == "read")
    return Agreement(right, linked - right, read - right), treated


def _id(row: Sequence[object]) -> Id:
    agent, scene, epoch = row[:3]
    assert isinstance(agent, str)
    assert isinstance(scene, int)
    assert isinstance(epoch, int)
    return agent, scene, epoch


def test_each_episode_is_labelled_once_and_only_with_known_modes() -> None:
    rows = [row for sample in SAMPLES for row in LABELS[sample]]
    assert len({_id(row) for row in rows}) == len(rows) >= 200
    assert {mode for row in rows for mode in row[4]} <= set(FailureMode)
    assert {row[5] for row in LABELS["numbers"]} == {"read", "own", "no assertion"}
    assert len(LABELS["numbers"]) >= 40


def test_the_intervals_on_the_page_follow_from_its_counts() -> None:
    """Runs without the logs: each mode has a precision and a recall, each with its Wilson interval."""
    found = re.findall(r"(\d+)/(\d+) = (\d+ %) \((\d+–\d+)\)", DOC.read_text(encoding="utf-8"))
    assert len(found) == 2 * len(FailureMode)
    for part, whole, share, interval in found:
        assert f"{part}/{whole} = {share} ({interval})" == _share_with_interval(int(part), int(whole))


@pytest.mark.published
@pytest.mark.parametrize("mode", list(FailureMode))
def test_the_precision_of_each_detector_is_at_least_85_per_cent(judged: dict[Id, Judged], mode: FailureMode) -> None:
    rows = [row for sample in SAMPLES for row in LABELS[sample]]
    precision = agreement(judged, rows, mode).precision
    assert precision is not None
    assert precision >= 0.85


@pytest.mark.published
def test_links_to_the_source_of_a_number_have_high_precision_and_recall(judged: dict[Id, Judged]) -> None:
    links, treated = link_agreement(judged)
    assert links.precision is not None
    assert links.recall is not None
    assert (links.precision >= 0.95, links.recall >= 0.9) == (True, True), treated


@pytest.mark.published
def test_the_page_has_the_measured_figures(judged: dict[Id, Judged], *, update_goldens: bool) -> None:
    page = DOC.read_text(encoding="utf-8")
    before, _, rest = page.partition(BEGIN)
    _, sign, after = rest.partition(END)
    assert sign
    remade = before + BEGIN + measured(judged) + END + after
    if update_goldens:
        DOC.write_text(remade, encoding="utf-8")
    assert page == remade, "remake it with `pytest tests/evaluator/scores/failures/test_labels.py --update-goldens`"


def measured(judged: dict[Id, Judged]) -> str:
    """The tables of the page."""
    blocks = [
        "### The samples\n\n" + _composition(judged),
        "### Precision and recall of each detector\n\n" + _detectors(judged),
        "### Provenance links\n\n" + _links(judged),
        f"### All {len(judged)} episodes\n\n" + _all_episodes(judged),
    ]
    return "\n" + "\n\n".join(blocks) + "\n\n"


def _composition(judged: dict[Id, Judged]) -> str:
    lines: list[Sequence[str]] = []
    for sample in SAMPLES:
        for agent in sorted({row[0] for row in LABELS[sample]}):
            rows = [row for row in LABELS[sample] if row[0] == agent]
            right = sum(judged[_id(row)].grade.strict is Verdict.CORRECT for row in rows)
            drawn = sum(row[3] != "any" for row in rows)
            lines.append((sample, agent, str(right), str(len(rows) - right), str(drawn)))
    return markdown_table(("sample", "model", "strictly right", "wrong", "of these drawn for an error"), lines)


def _detectors(judged: dict[Id, Judged]) -> str:
    lines: list[Sequence[str]] = []
    for mode in FailureMode:
        cells = [" / ".join(map(str, agreement(judged, LABELS[sample], mode))) for sample in SAMPLES]
        total = agreement(judged, [row for sample in SAMPLES for row in LABELS[sample]], mode)
        precision = _share_with_interval(total.both, total.both + total.found_only)
        recall = _share_with_interval(total.both, total.both + total.labelled_only)
        lines.append((_worded(mode), *cells, precision, recall))
    return markdown_table(("mode", *SAMPLES, "precision (95 %)", "recall (95 %)"), lines)


def _links(judged: dict[Id, Judged]) -> str:
    links, treated = link_agreement(judged)
    hows = ("linked", "unsupported", "left out")
    labels = (("read", "read from a return"), ("own", "the agent's own"), ("no assertion", "no assertion"))
    lines = [(said, *(str(treated[label, how]) for how in hows)) for label, said in labels]
    precision = _share(links.both, links.both + links.found_only)
    recall = _share(links.both, links.both + links.labelled_only)
    table = markdown_table(("the number was", *hows), lines)
    return f"{table}\n\nThe precision of the links is {precision}, and their recall is {recall}."


def _all_episodes(judged: dict[Id, Judged]) -> str:
    agents = sorted({agent for agent, _, _ in judged})
    groups = [[episode for (agent, _, _), episode in judged.items() if agent == name] for name in agents]
    wrong = [sum(episode.grade.strict is Verdict.INCORRECT for episode in group) for group in groups]
    counts = [f"{len(group)} ({count})" for group, count in zip(groups, wrong, strict=True)]
    lines: list[Sequence[str]] = [("episodes (wrong)", *counts)]
    for mode in FailureMode:
        cells = [
            f"{sum(mode in episode.found for episode in group)}"
            f" ({sum(mode in episode.found and episode.grade.strict is Verdict.INCORRECT for episode in group)})"
            for group in groups
        ]
        lines.append((_worded(mode), *cells))
    for name in ("e", "g", "v", "r"):
        values = [[getattr(episode.scores, name) for episode in group] for group in groups]
        cells = [
            f"{fmean(value or 0.0 for value in group):.3f} ({sum(value is None for value in group)};"
            f" {fmean(value for value in group if value is not None):.3f})"
            for group in values
        ]
        lines.append((f"mean {name.upper()} with undefined 0 (undefined in; over the others)", *cells))
    lines.append(("mean G′", *(f"{_held_out(group):.3f}" for group in groups)))
    lines += [(f"published {name}, over four budgets", *values) for name, *values in PUBLISHED]
    return markdown_table(("", *agents), lines)


def _held_out(group: Sequence[Judged]) -> float:
    """Return G′ of the episodes of one agent and budget, with the paper's categories of scene ids."""
    packs = {files.scene_id: read_pack(files) for files in parse_scenes(None, None)}
    categories = {scene: pack.category.value for scene, pack in packs.items() if pack.category}
    rows = [scored(_alike(judged.episode), judged.grade, categories[judged.episode.key.scene]) for judged in group]
    found = held_out_accuracy(rows)
    return fmean(next(value for (_, name), value in found.items() if name == row.category) for row in rows)


def _alike(episode: Episode) -> Episode:
    """Return the episode with budget 5, so that all are in one group; a log with an extra reply has a larger budget."""
    return episode.model_copy(update={"key": episode.key.model_copy(update={"budget": 5})})


def _share(part: int, whole: int) -> str:
    return f"{part}/{whole} = {100 * part / whole:.0f} %" if whole else "–"


def _share_with_interval(part: int, whole: int) -> str:
    interval = wilson_interval(part, whole)
    return f"{_share(part, whole)} ({100 * interval.low:.0f}–{100 * interval.high:.0f})"


def _worded(mode: FailureMode) -> str:
    return mode.value.replace("_", " ")
