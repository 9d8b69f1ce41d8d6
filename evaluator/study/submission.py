"""A submission: the results of a run in one file that anyone can check against the run folder.

Every field is computed from the folder, so a check computes it again and compares.
"""

import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import Literal

from pydantic import Field, ValidationError

from evaluator.agents.recorded import different_values
from evaluator.answers.grading import GRADER_VERSION
from evaluator.answers.keys import KeyRing
from evaluator.errors import StoreError, UsageError, reason_of
from evaluator.records.episode import FORMAT, EpisodeKey, Frame, GradeRecord, Outcome, Record, is_absent
from evaluator.records.run import RunRecord
from evaluator.scores.metrics import RunSummary, summarise
from evaluator.scores.scored_episode import WITHDRAWN, ScoredEpisode
from evaluator.scores.scoring import graded_rows
from evaluator.store.durable import Seal
from evaluator.store.run_folder import RunFolder
from evaluator.study.integrity import refuse_other_packs
from evaluator.study.replay import REL_TOL
from scenes import reference_of


class Submission(Record):
    """The results of a whole run, their provenance, and hashes of the run's records."""

    format: Literal[1] = FORMAT
    run: RunRecord
    """Contents of `run.json`: matrix, agents, packs, server and software."""
    seed_commitment: str = Field(default="", exclude_if=is_absent)
    """Commitment to the key of held-back seeds; absent if the seeds are as recorded."""
    seal: Seal
    """Contents of `seal.json`; its head covers every record and their order."""
    episodes_sha256: str
    """SHA-256 of `episodes.jsonl`."""
    unsealed_episodes: int
    """Number of episodes whose agent could have had information other than its measurements."""
    withdrawn: tuple[str, ...] = Field(default=(), exclude_if=is_absent)
    """Hashes of the packs whose episodes have no verdict because of a known fault; absent if there are none."""
    grader_version: str
    verdicts_sha256: str
    """SHA-256 of the keys and verdicts of all grades, in the order of the episodes."""
    summary: RunSummary


def submission_of(folder: RunFolder, keys: KeyRing) -> Submission:
    """Grade a run again and collect its results. Writes nothing.

    Args:
        folder: The run.
        keys: Answer keys of its scenes.

    Raises:
        UsageError: The run is incomplete, was not graded, or was played on other packs.
        StoreError: Its records do not match their seal.
    """
    record, seal = folder.read_run(), _intact_seal(folder)
    if record.forked_from is not None:
        raise UsageError(f"{folder.path} continues episodes of another run, so its results are not those of its agents")
    _check_whole(folder, record)
    refuse_other_packs(record, keys.folder)
    _check_frames(folder)
    rows = graded_rows(folder, keys)
    _check_grades(folder, rows)
    return Submission(
        run=record,
        seed_commitment=record.plan.held_back,
        seal=seal,
        episodes_sha256=hashlib.sha256(folder.episodes_file.read_bytes()).hexdigest(),
        unsealed_episodes=sum(row.episode.unsealed is not None for row in rows),
        withdrawn=tuple(sorted({row.erratum.pack for row in rows if row.erratum is not None and row.is_withdrawn})),
        grader_version=GRADER_VERSION,
        verdicts_sha256=hashlib.sha256("\n".join(_verdict(row.record) for row in rows).encode()).hexdigest(),
        summary=summarise(rows),
    )


def read_submission(file: Path) -> Submission:
    """Read a submission from its file.

    Raises:
        UsageError: The file cannot be read or is not a submission.
    """
    try:
        return Submission.model_validate_json(file.read_bytes())
    except OSError as error:
        raise UsageError(f"{file} cannot be read: {error.strerror}") from error
    except ValidationError as error:
        raise UsageError(f"{file} is no submission: {reason_of(error)}") from error


def first_difference(claimed: Submission, found: Submission) -> str:
    """Describe the first difference between two submissions of a run as a clause; empty if there is none.

    Numbers may differ by one part in 10⁹, because versions of the statistics libraries differ in the last digits. If
    the scoring versions differ, the verdicts are compared and the numbers of the summary are not.

    Args:
        claimed: The submission to check.
        found: The submission computed from the run folder.
    """
    rescored = claimed.summary.scoring_version != found.summary.scoring_version
    left_out = {"summary"} if rescored else set[str]()
    before, now = (one.model_dump(mode="json", exclude=left_out) for one in (claimed, found))
    for path, old, new in different_values(before, now, REL_TOL, ""):
        return f"{path} is {old!r} in the submission, and {new!r} in the run folder"
    return ""


def _intact_seal(folder: RunFolder) -> Seal:
    seal = folder.read_seal()
    if seal is None:
        raise StoreError(f"{folder.path} is not sealed, so nothing tells whether its records are as they were written")
    lines = folder.episode_lines()
    problem = seal.problem(lines)
    if not problem and len(lines) > seal.lines:
        problem = f"{seal.lines} episodes were sealed, and {len(lines)} are there"
    if problem:
        raise StoreError(f"{folder.episodes_file} is not what the run wrote: {problem}")
    if seal.edited:
        raise StoreError(f"{folder.episodes_file} is not what the run wrote: {seal.edited[0]}")
    return seal


def _check_whole(folder: RunFolder, record: RunRecord) -> None:
    """Raise if a run lacks episodes, because unfavourable ones could have been removed."""
    episodes = folder.episodes()
    wanted = record.plan.matrix()
    unplayed = [key for key in wanted if key not in episodes or episodes[key].outcome is Outcome.INFRASTRUCTURE_ERROR]
    if unplayed:
        raise UsageError(
            f"{folder.path} lacks {len(unplayed)} of {len(wanted)} episodes, the first of them {_named(unplayed[0])};"
            " play them with --resume, or merge the shards"
        )
    planned = set(wanted)
    extra = next((key for key in episodes if key not in planned), None)
    if extra is not None:
        raise UsageError(f"{folder.path} holds an episode that is not in its plan, {_named(extra)}")


def _check_frames(folder: RunFolder) -> None:
    """Raise if a frame is missing, or its content does not have the hash in its name."""
    names = {
        frame.name
        for episode in folder.episodes().values()
        for turn in episode.turns
        for exchange in turn.exchanges
        for frame in exchange.frames
    }
    for name in sorted(names):
        file = folder.frames_folder / f"{name}.png"
        try:
            same = Frame.of(file.read_bytes()).name == name
        except OSError as error:
            raise StoreError(f"{file} cannot be read: {error.strerror}") from error
        if not same:
            raise StoreError(f"{file} is not the frame that the records name")


def _check_grades(folder: RunFolder, rows: list[ScoredEpisode]) -> None:
    """Raise if grading again gives other grades than the stored ones.

    A stored grade may be withdrawn by an erratum that the given answer keys do not contain, because a check ignores
    errata that were published after the submission.
    """
    stored: Mapping[EpisodeKey, GradeRecord] = folder.grades()
    for row in rows:
        if row.key not in stored:
            raise UsageError(
                f"{folder.path}: not every episode is graded; run `physment-eval grade {folder.path}` first"
            )
        kept, now = stored[row.key].grade, row.record.grade
        if kept.reason.startswith(WITHDRAWN) and not row.is_withdrawn:
            continue
        if _verdict(stored[row.key]) != _verdict(row.record):
            raise UsageError(
                f"{folder.grades_file}: the grade of {_named(row.key)} is {kept.strict.value}, {kept.normalised.value},"
                f" {kept.graded}; grading again gives {now.strict.value}, {now.normalised.value}, {now.graded}"
            )


def _verdict(record: GradeRecord) -> str:
    """Return the hashed part of a grade. Answer key and reason are not hashed: runs with held-back seeds omit them."""
    grade = record.grade
    return f"{record.key.model_dump_json()} {grade.strict.value} {grade.normalised.value} {grade.graded}"


def _named(key: EpisodeKey) -> str:
    return f"scene {reference_of(key.scene)}, seed {key.seed}, {key.agent}, budget {key.budget}, epoch {key.epoch}"
