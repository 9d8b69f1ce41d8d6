"""Tests of summaries of evidence, and of the grade of an episode on a withdrawn pack."""

from datetime import date

import pytest

from evaluator.records.episode import Outcome, Verdict
from evaluator.records.evidence import CallEvidence, EvidenceRecord, EvidenceVerdict
from evaluator.scores.scored_episode import MeasuredEpisode, evidence_summary, is_withdrawn, withdrawn_grade
from scenes import Erratum, ErratumEffect
from tests.builders.records import ANSWER, LOOK, STEP, episode, episode_key, returned, turn


def measured(verdict: Verdict, *bounds: float, not_measurable: str = "") -> MeasuredEpisode:
    """Return an answered episode of one call for each bound, one further call and the answer, with its evidence."""
    calls = [returned(LOOK.tool, **LOOK.arguments) for _ in bounds] + [returned(STEP.tool, **STEP.arguments)]
    played = episode(turn("", *calls, returned(ANSWER.tool, **ANSWER.arguments)), outcome=Outcome.ANSWERED)
    steps = tuple(CallEvidence(turn=1, call=n, bounds=(bound,), bits=1) for n, bound in enumerate(bounds, 1))
    record = EvidenceRecord(key=episode_key(7), episode="0", calls=steps, not_measurable=not_measurable)
    return MeasuredEpisode(played, record, verdict)


def test_the_summary_of_evidence_counts_verdicts_and_calls() -> None:
    assert evidence_summary([]) is None
    found = evidence_summary(
        [
            measured(Verdict.CORRECT, 2.0, 0.4),
            measured(Verdict.INCORRECT, 0.1),
            measured(Verdict.CORRECT, 3.0),
            measured(Verdict.INCORRECT, 3.0),
            measured(Verdict.CORRECT, not_measurable="a contact"),
        ]
    )
    assert found is not None
    assert found.verdicts == dict.fromkeys(EvidenceVerdict, 1)
    assert (found.not_measurable, found.answered_before) == (1, 2)
    # Sufficient after calls 2 of 3 and 1 of 2; the answer does not count as a call.
    assert (found.calls_until, found.calls_after) == (1.5, 1)


def test_without_sufficient_evidence_there_is_no_number_of_calls() -> None:
    found = evidence_summary([measured(Verdict.INCORRECT, 3.0)])
    assert found is not None
    assert (found.calls_until, found.calls_after) == (None, None)


@pytest.mark.parametrize(
    ("effect", "outcome", "withdrawn"),
    [
        (ErratumEffect.WITHDRAWN, Outcome.ANSWERED, True),
        (ErratumEffect.WITHDRAWN, Outcome.INFRASTRUCTURE_ERROR, False),
        (ErratumEffect.NOTED, Outcome.ANSWERED, False),
    ],
)
def test_an_episode_on_a_withdrawn_pack_is_not_scored(effect: ErratumEffect, outcome: Outcome, withdrawn: bool) -> None:
    erratum = Erratum(scene=7, pack=f"c1:{'0' * 12}", effect=effect, fault="The key is wrong.", date=date(2026, 1, 1))
    assert is_withdrawn(episode(outcome=outcome), erratum) is withdrawn
    grade = withdrawn_grade(erratum)
    assert (grade.strict, grade.graded, grade.normalised) == (Verdict.UNSCORED, None, Verdict.UNSCORED)
    assert grade.reason.endswith("The key is wrong.")
