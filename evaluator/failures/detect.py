"""All six detectors over one episode. Pure: an episode, its grade, the form of its answer in; findings out."""

from evaluator.failures.answering import answer_format, premature_answer, too_little_time
from evaluator.failures.calling import object_id_confusion, wrong_parameter
from evaluator.failures.findings import AnswerForm, Failure
from evaluator.failures.reasoning import theory_or_simulation
from evaluator.records import Episode, Grade, Verdict


def failures_of(episode: Episode, grade: Grade, form: AnswerForm) -> tuple[Failure, ...]:
    """The failure modes of an episode, each at most once; none where it is unscored.

    Args:
        episode: As recorded.
        grade: Its grade.
        form: What the question asks for.
    """
    if grade.strict is Verdict.UNSCORED:
        return ()
    found = (
        premature_answer(episode),
        too_little_time(episode),
        answer_format(episode, grade, form),
        object_id_confusion(episode, form.objects),
        wrong_parameter(episode),
        theory_or_simulation(episode),
    )
    return tuple(one for one in found if one is not None)
