"""Grades and scores recorded episodes, and summarises runs. Plays no episode.

Each episode is scored once. Output, reports and comparisons use that result.
"""

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from typing import NamedTuple

from pydantic import JsonValue

from evaluator.answers.grading import GRADER_VERSION, grade_episode
from evaluator.answers.keys import KeyRing
from evaluator.answers.laws import LAW_GRADER_VERSION, grade_law, hash_of, stated_law
from evaluator.answers.rewards import chance_at
from evaluator.answers.strict import AnswerKey
from evaluator.errors import UsageError
from evaluator.records.episode import Episode, EpisodeKey, Grade, GradeRecord, LawGrade, Verdict
from evaluator.records.evidence import EvidenceRecord
from evaluator.scores.dimensions import cost_of, dimensions
from evaluator.scores.failures.detect import failures_of
from evaluator.scores.failures.findings import expected_form
from evaluator.scores.grounding import grounding_of
from evaluator.scores.metrics import RunSummary, summarise
from evaluator.scores.scored_episode import ScoredEpisode, is_withdrawn, withdrawn_grade
from evaluator.store.run_folder import RunFolder
from scenes import content_hash_of, reference_of

WITHHELD = "withheld until the seeds are revealed"
"""Replaces the reason of a grade, which may quote the key."""


class GradedRun(NamedTuple):
    """A run that has just been graded."""

    rows: Sequence[ScoredEpisode]
    summary: RunSummary
    changes: Sequence[str]
    """One line per changed verdict, and a last line with the file of the old grades; empty if no verdict changed."""


def score_episode(
    episode: Episode, record: GradeRecord, keys: KeyRing, evidence: EvidenceRecord | None = None
) -> ScoredEpisode:
    """Compute the scores that depend on one episode alone.

    Args:
        episode: The recorded episode.
        record: Its grade, which is replaced if the pack of the episode has been withdrawn since.
        keys: Answer keys of the packs that it was played on.
        evidence: The evidence of the episode; None if it was not measured.

    Raises:
        UsageError: The pack is missing or malformed.
    """
    erratum = keys.erratum(episode.versions.pack)
    if is_withdrawn(episode, erratum):
        record = grade_record(episode, keys)
    facts, grounding = keys.facts(episode.key.scene), grounding_of(episode)
    form = keys.key(episode.key.scene, 0)
    return ScoredEpisode(
        episode=episode,
        record=record,
        scene_name=facts.name,
        category=facts.category,
        problem_type=facts.problem_type,
        scores=dimensions(episode, record.grade, grounding, facts.disabled_tools),
        chance=chance_at(form, record.answer_key),
        experiment_cost=cost_of(episode, facts.limits),
        grounding=grounding,
        failures=failures_of(episode, record.grade, expected_form(form, facts.task)),
        erratum=erratum,
        evidence=evidence,
        asks_for_law=facts.asks_for_law,
    )


def grade_run(
    folder: RunFolder,
    keys: KeyRing,
    *,
    withhold: bool = False,
    kept: Collection[int] = (),
    keep_laws: bool = False,
    tracked: Callable[[Sequence[Episode]], Iterable[Episode]] = iter,
) -> GradedRun:
    """Grade and score all episodes of a run, and write its grades and its summary.

    If a verdict changed, the previous grades are kept in a second file.

    Args:
        folder: The run.
        keys: Answer keys of its scenes.
        withhold: Whether to omit answer keys and reasons from the grades, because the seeds of the run are held back.
        kept: Scenes whose stored grades are kept, because the packs here are not those of the run.
        keep_laws: Whether to keep the stored grades of unchanged laws; computing one takes about a second.
            Only for a run whose grades this program has written.
        tracked: Function that yields the given episodes and shows the progress.

    Raises:
        UsageError: A pack is malformed or gives no key, or an episode has no stored grade that could be kept.
        StoreError: The folder cannot be read or written.
    """
    before = folder.grades()
    rows = graded_rows(
        folder, keys, withhold=withhold, kept=kept, before=before if keep_laws else None, tracked=tracked
    )
    records = [row.record for row in rows]
    changes = _changes(before, records)
    if changes:
        changes.append(f"the previous grades are kept in {folder.keep_grades()}")
    folder.write_grades(records)
    summary = summarise(rows)
    folder.write_text(folder.summary_file, summary.model_dump_json(indent=2) + "\n")
    return GradedRun(rows, summary, changes)


def graded_rows(
    folder: RunFolder,
    keys: KeyRing,
    *,
    withhold: bool = False,
    kept: Collection[int] = (),
    before: Mapping[EpisodeKey, GradeRecord] | None = None,
    tracked: Callable[[Sequence[Episode]], Iterable[Episode]] = iter,
) -> list[ScoredEpisode]:
    """Grade and score the episodes of a run. Writes nothing.

    Args:
        folder: The run.
        keys: Answer keys of its scenes.
        withhold: Whether to omit answer keys and reasons from the grades.
        kept: Scenes whose stored grades are kept.
        before: Earlier grades; those of unchanged laws are kept. None to grade all laws again.
        tracked: Function that yields the given episodes and shows the progress.

    Raises:
        UsageError: A pack is malformed or gives no key, or an episode has no stored grade that could be kept.
        StoreError: The folder cannot be read.
    """
    stored, evidence = folder.grades() if kept else {}, folder.evidence()

    def graded(episode: Episode) -> GradeRecord:
        withdrawn = is_withdrawn(episode, keys.erratum(episode.versions.pack))
        if episode.key.scene in kept and not withdrawn:
            return _stored(episode, stored)
        record = grade_record(episode, keys)
        if not withdrawn:
            record = record.model_copy(update={"law": law_grade(episode, keys, (before or {}).get(episode.key))})
        if withdrawn or not withhold:
            return record
        return record.model_copy(
            update={"answer_key": None, "grade": record.grade.model_copy(update={"reason": WITHHELD})}
        )

    episodes = tracked(list(folder.episodes().values()))
    return [score_episode(one, graded(one), keys, evidence.get(one.key)) for one in episodes]


def _stored(episode: Episode, stored: Mapping[EpisodeKey, GradeRecord]) -> GradeRecord:
    if episode.key not in stored:
        raise UsageError(
            f"scene {reference_of(episode.key.scene)} was played on another pack than the one here, whose key may be"
            " another; name the folder of its pack by --scenes-dir, or grade with the pack here by --allow-other-packs"
        )
    return stored[episode.key]


def grade_record(episode: Episode, keys: KeyRing) -> GradeRecord:
    """Return the grade record of one episode, with the answer key; without verdict and key if its pack is withdrawn."""
    grade, key = _graded(episode, keys)
    return GradeRecord(
        key=episode.key,
        grade=grade,
        answer_key=key,
        grader_version=GRADER_VERSION,
        pack_version=episode.versions.pack,
    )


def law_grade(episode: Episode, keys: KeyRing, stored: GradeRecord | None = None) -> LawGrade | None:
    """Grade the law of an episode; None if the agent wrote no law, or the law of the scene cannot be written as text.

    Args:
        episode: The recorded episode.
        keys: The true laws of all scenes.
        stored: An earlier grade. It is returned if pack, law and version of the grader are still the same.

    Raises:
        UsageError: The pack is malformed.
    """
    law = stated_law(episode)
    true = None if law is None else keys.law(episode.key.scene, episode.key.seed)
    if true is None:
        return None
    if stored is not None and stored.law is not None:
        before = stored.pack_version, stored.law.version, stored.law.sha256
        if before == (episode.versions.pack, LAW_GRADER_VERSION, hash_of(law)):
            return stored.law
    return grade_law(law, true)


def strict_verdict(episode: Episode, keys: KeyRing) -> Verdict:
    """Return the strict verdict of an episode, for displays; unscored if its pack is withdrawn."""
    grade, _ = _graded(episode, keys)
    return grade.strict


def _graded(episode: Episode, keys: KeyRing) -> tuple[Grade, JsonValue]:
    """Return the grade of an episode and the answer key that it was compared with; no key if the pack is withdrawn."""
    erratum = keys.erratum(episode.versions.pack)
    if erratum is not None and is_withdrawn(episode, erratum):
        return withdrawn_grade(erratum), None
    key = keys.key(episode.key.scene, episode.key.seed)
    return grade_episode(episode, key), _plain(key)


def read_graded(folder: RunFolder) -> list[tuple[Episode, GradeRecord]]:
    """Return the episodes of a run with their stored grades.

    Raises:
        UsageError: Some episodes have no grade.
        StoreError: The folder cannot be read.
    """
    episodes, grades = folder.episodes(), folder.grades()
    if set(grades) != set(episodes):
        raise UsageError(f"{folder.path}: not every episode is graded; run `physment-eval grade {folder.path}` first")
    return [(episode, grades[key]) for key, episode in episodes.items()]


def _law_reason(before: str, now: str) -> str:
    if before == now:
        return "the stored grade is not that of this grader"
    return f"law grader {before} → {now}"


_EQUIVALENCE = {True: "equivalent", False: "not equivalent"}


def _changes(previous: Mapping[EpisodeKey, GradeRecord], records: Iterable[GradeRecord]) -> list[str]:
    """Describe each changed verdict, on an answer or a law, on one line.

    Grades that were missing or unscored before are not listed.
    """
    lines: list[str] = []
    for new in records:
        old = previous.get(new.key)
        if old is None or old.grade.strict is Verdict.UNSCORED:
            continue
        named = f"scene {reference_of(new.key.scene)} seed {new.key.seed} {new.key.agent}"
        if old.law is not None and new.law is not None and old.law.equivalent is not new.law.equivalent:
            lines.append(
                f"{named}: law {_EQUIVALENCE[old.law.equivalent]} → {_EQUIVALENCE[new.law.equivalent]}"
                f" ({_law_reason(old.law.version, new.law.version)})"
            )
        verdicts = [(old.grade.strict, new.grade.strict), (old.grade.normalised, new.grade.normalised)]
        if all(before is after for before, after in verdicts):
            continue
        reasons = [
            f"{name} {before} → {after}"
            for name, before, after in (
                ("grader", old.grader_version, new.grader_version),
                ("pack", content_hash_of(old.pack_version), content_hash_of(new.pack_version)),
                ("key", old.answer_key, new.answer_key),
            )
            if before != after
        ]
        if new.grade.strict is Verdict.UNSCORED:
            reasons = [new.grade.reason]
        lines.append(
            f"{named}: strict {verdicts[0][0].value} →"
            f" {verdicts[0][1].value}, normalised {verdicts[1][0].value} → {verdicts[1][1].value}"
            f" ({', '.join(reasons) or 'same grader, pack and key'})"
        )
    return lines


def _plain(key: AnswerKey) -> JsonValue:
    return list(key.value) if isinstance(key.value, tuple) else key.value
