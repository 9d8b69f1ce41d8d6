"""Certificates 1 and 4: theory, engine and reference agent agree on the key, and no constant answer is often right."""

from collections.abc import Sequence

from evaluator.agents.fixed import best_constant
from evaluator.answers.steps import grade_steps, stated_steps
from evaluator.certify.records import Check, check
from evaluator.certify.subject import Draw, Subject, gap
from evaluator.records.episode import Episode, Outcome
from scenes.draw import step_values

HALVED_SEEDS = 3
"""Number of seeds on which the time step is halved."""
THEORY_DRAWS, ENGINE_DRAWS = 200, 30
"""Number of draws on which constants are tried; fewer if each key needs an engine run."""


def check_key(subject: Subject, episodes: Sequence[Episode]) -> Check:
    """Check that theory, engine, halved time step and the reference's answers agree within shares of the tolerance.

    Args:
        subject: The scene.
        episodes: The reference agent's episodes at seeds 0, 1, ….
    """
    reasons: list[str] = []
    worst_engine, worst_half, worst_answer = 0.0, 0.0, 0.0
    stored, first = subject.pack.answer, subject.truth(subject.draw(0))
    if not subject.agrees(stored, first, 0.05):
        reasons.append(f"the stored answer is {stored}, but the key at seed 0 is {first}")
    for seed, episode in enumerate(episodes):
        draw = subject.draw(seed)
        key = subject.truth(draw)
        reasons += _refusals(episode)
        if episode.outcome is not Outcome.ANSWERED:
            reasons.append(f"seed {seed}: the reference ended with {episode.outcome.value}: {episode.error or ''}")
        else:
            worst_answer = max(worst_answer, gap(episode.answer, key))
            if not subject.agrees(episode.answer, key, 0.5):
                reasons.append(f"seed {seed}: the reference answered {episode.answer}; the key is {key}")
            reasons += _wrong_steps(subject, episode, draw)
        engine = subject.measured(draw)
        if engine is None:
            continue
        worst_engine = max(worst_engine, gap(engine, key))
        if not subject.agrees(engine, key, 0.25):
            reasons.append(f"seed {seed}: theory gives {key}, the engine {engine}")
        if 0 < seed <= HALVED_SEEDS:
            halved = subject.measured(draw, 0.0025)
            assert halved is not None
            worst_half = max(worst_half, gap(halved, engine))
            if not subject.agrees(halved, engine, 0.25):
                reasons.append(f"seed {seed}: half the time step gives {halved}, the whole one {engine}")
    if subject.solution.measure is None:
        reasons.append("solution.py defines no measure, so the engine was never asked")
    return check(
        "key",
        reasons,
        key_from="theory" if subject.solution.theory else "engine",
        theory_engine_gap=worst_engine,
        answer_gap=worst_answer,
        half_step_gap=worst_half,
    )


def _wrong_steps(subject: Subject, episode: Episode, draw: Draw) -> list[str]:
    """What the reference does not state rightly of the intermediate quantities that the scene names."""
    values = step_values(subject.files, subject.pack, draw.knobs)
    graded = grade_steps(episode, values) or {}
    return [
        f"seed {episode.key.seed}: the reference states {stated_steps(episode).get(name)} for {name}, which is"
        f" {values[name]:.6g}"
        for name, right in graded.items()
        if not right
    ]


def _refusals(episode: Episode) -> list[str]:
    exchanges = (exchange for turn in episode.turns for exchange in turn.exchanges)
    refused = next((exchange for exchange in exchanges if exchange.is_error), None)
    if refused is None:
        return []
    return [f"seed {episode.key.seed}: the reference's {refused.call.tool} was refused: {refused.text}"]


def check_constant(subject: Subject) -> Check:
    """Check that even the best constant answer is not right more often than allowed."""
    count = THEORY_DRAWS if subject.solution.theory else ENGINE_DRAWS
    keys = [subject.truth(subject.draw(seed)) for seed in range(1, count + 1)]
    _, share = best_constant(keys, subject.spec)
    options = subject.spec.options
    allowed = 1 / len(options) + 0.10 if options else 0.20
    reasons = (
        [f"one constant answer is right on {share:.0%} of {count} draws; at most {allowed:.0%} may be: widen the knobs"]
        if share > allowed
        else []
    )
    return check("constant", reasons, best_constant=share, allowed=allowed, draws=count)
