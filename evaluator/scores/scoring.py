"""The second pass: recorded episodes and answer keys → grades, scores and the run's numbers. Plays nothing."""

from collections.abc import Iterable, Mapping

from pydantic import JsonValue

from evaluator.answers.grading import GRADER_VERSION, AnswerKey, grade_episode
from evaluator.answers.keys import KeyRing
from evaluator.failures.detect import failures_of
from evaluator.failures.findings import form_of
from evaluator.records import Episode, EpisodeKey, GradeRecord, Verdict
from evaluator.scores.metrics import RunSummary, ScoredEpisode, summarise
from evaluator.store import RunFolder


def grade_run(folder: RunFolder, episodes: Mapping[EpisodeKey, Episode], keys: KeyRing) -> tuple[list[str], RunSummary]:
    """Grade all episodes of a run and write its grades and summary.

    Returns:
        What changed against the grades that were there, a line each, and the summary. Where something did, the grades
        of before are kept beside the new ones.

    Raises:
        UsageError: A pack is malformed or gives no key.
        StoreError: The folder cannot be written.
    """
    grades = [grade_record(episode, keys) for episode in episodes.values()]
    changes = _changes(folder.grades(), grades)
    if changes:
        changes.append(f"the grades of before are kept in {folder.keep_grades()}")
    folder.write_grades(grades)
    summary = summarise(scored(episodes.values(), grades, keys))
    folder.write_text(folder.summary_file, summary.model_dump_json(indent=2) + "\n")
    return changes, summary


def _changes(before: Mapping[EpisodeKey, GradeRecord], now: Iterable[GradeRecord]) -> list[str]:
    """A line for each verdict that is not what it was, and why it may be."""
    lines: list[str] = []
    for one in now:
        old = before.get(one.key)
        if old is None or old.grade.strict is Verdict.UNSCORED:
            continue
        verdicts = [(old.grade.strict, one.grade.strict), (old.grade.normalised, one.grade.normalised)]
        if all(was is is_now for was, is_now in verdicts):
            continue
        reasons = [
            f"{name} {was} → {is_now}"
            for name, was, is_now in (
                ("grader", old.grader_version, one.grader_version),
                ("pack", old.pack_version, one.pack_version),
                ("key", old.answer_key, one.answer_key),
            )
            if was != is_now
        ]
        lines.append(
            f"scene {one.key.scene} seed {one.key.seed} {one.key.agent}: strict {verdicts[0][0].value} →"
            f" {verdicts[0][1].value}, normalised {verdicts[1][0].value} → {verdicts[1][1].value}"
            f" ({', '.join(reasons) or 'same grader, pack and key'})"
        )
    return lines


def grade_record(episode: Episode, keys: KeyRing) -> GradeRecord:
    """The grade of one episode, with the key it was graded against."""
    key = keys.key(episode.key.scene, episode.key.seed)
    return GradeRecord(
        key=episode.key,
        grade=grade_episode(episode, key),
        answer_key=_plain(key),
        grader_version=GRADER_VERSION,
        pack_version=episode.versions.pack,
    )


def scored(episodes: Iterable[Episode], grades: Iterable[GradeRecord], keys: KeyRing) -> list[ScoredEpisode]:
    """Episodes with their grades and what reports group them by."""
    by_key = {one.key: one.grade for one in grades}
    rows: list[ScoredEpisode] = []
    for episode in episodes:
        facts = keys.facts(episode.key.scene)
        rows.append(
            ScoredEpisode(
                episode=episode,
                grade=by_key[episode.key],
                category=facts.category,
                problem_type=facts.problem_type,
                disabled_tools=facts.disabled_tools,
                failures=failures_of(episode, by_key[episode.key], form_of(keys.key(episode.key.scene, 0))),
            )
        )
    return rows


def _plain(key: AnswerKey) -> JsonValue:
    return list(key.value) if isinstance(key.value, tuple) else key.value
