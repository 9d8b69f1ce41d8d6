"""The second pass: recorded episodes and answer keys → grades, scores and the run's numbers. Plays nothing."""

from collections.abc import Iterable, Mapping

from pydantic import JsonValue

from evaluator.answer_key import KeyRing
from evaluator.grading import GRADER_VERSION, AnswerKey, grade_episode
from evaluator.metrics import RunSummary, ScoredEpisode, summarise
from evaluator.records import Episode, EpisodeKey, GradeRecord
from evaluator.store import RunFolder


def grade_run(folder: RunFolder, episodes: Mapping[EpisodeKey, Episode], keys: KeyRing) -> RunSummary:
    """Grade all episodes of a run and write its grades and summary.

    Raises:
        UsageError: A pack is malformed or gives no key.
        StoreError: The folder cannot be written.
    """
    grades = [grade_record(episode, keys) for episode in episodes.values()]
    folder.write_grades(grades)
    summary = summarise(scored(episodes.values(), grades, keys))
    folder.write_text(folder.summary_file, summary.model_dump_json(indent=2) + "\n")
    return summary


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
            )
        )
    return rows


def _plain(key: AnswerKey) -> JsonValue:
    return list(key.value) if isinstance(key.value, tuple) else key.value
