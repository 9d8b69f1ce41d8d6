"""Runs all six detectors on one episode. A pure function of the episode, its grade and the expected answer form."""

from evaluator.records.episode import Episode, Grade, Verdict
from evaluator.scores.failures.answering import answer_format, premature_answer, too_little_time
from evaluator.scores.failures.calling import object_id_confusion, wrong_parameter
from evaluator.scores.failures.findings import ExpectedForm, Failure
from evaluator.scores.failures.reasoning import theory_or_simulation


def failures_of(episode: Episode, grade: Grade, expected: ExpectedForm) -> tuple[Failure, ...]:
    """The failures of an episode, at most one of each mode; none if the episode is unscored.

    Args:
        episode: As recorded.
        grade: Its grade.
        expected: The form of answer that the question asks for.
    """
    if grade.strict is Verdict.UNSCORED:
        return ()
    found = (
        premature_answer(episode, grade),
        too_little_time(episode),
        answer_format(episode, grade, expected),
        object_id_confusion(episode, grade, expected),
        wrong_parameter(episode, grade),
        theory_or_simulation(episode),
    )
    return tuple(failure for failure in found if failure is not None)
