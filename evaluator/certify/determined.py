"""Certificate 12: readings and the task's family of laws determine the answer; a requested equilibrium is stable."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from evaluator.agents.reference import calls_and_readings
from evaluator.answers.engine import Engine
from evaluator.certify.records import Check, check
from evaluator.certify.subject import Draw, Subject
from evaluator.records.episode import Episode
from scenes import Pack
from scenes.family import EXCLUDED_SIGMAS, reduced_chi_square, surviving
from scenes.protocol import Member, Solution

_PLAUSIBLE, _AGREEING_SHARE = 40, 0.95
"""Number of answers computed from constants that fit the readings, and the share of them that must agree with
the key."""
_LARGEST_MISFIT = 4.0
"""Largest reduced chi-square of the drawn law; 4 means that the readings deviate by twice their stated errors."""
_OFF, _LEFT, _SHIFT = 0.02, 0.25, 0.005
"""Disturbance of the equilibrium, largest share of it that may remain, and tolerated offset of the equilibrium."""
_STATED = re.compile(r"\b(?:one|two|three|some) of: [^.:;]+;")
"""Matches the statement of a family in a task: "one of: first law; second law; or third law", "at most two of: …"."""
_EQUILIBRIUM = re.compile(
    r"\bis at rest at\b|\b(?:held|hold|holds|keeps?|stays?) (?:\w+ ){0,3}at\b(?! any)|\bequilibrium\b"
    r"|\b(?:has|would [^.?]{0,30})come to rest\b|\b(?:steady|constant) (?:speed|spin|angle)"
)
"""Phrases of a question about an equilibrium or another lasting state."""


@dataclass(frozen=True, slots=True)
class _Weighed:
    """Fit of the family's members to the readings of one episode."""

    faults: list[str]
    survivors: int = 0
    misfit: float = 0.0
    """Reduced chi-square of the drawn law."""
    right: float = 1.0
    """Share of the computed answers that agree with the key; the smallest among the surviving members."""


def check_determined(subject: Subject, episodes: Sequence[Episode]) -> Check:
    """Check that every law of the family that fits the reference agent's readings gives the answer in the key.

    Args:
        subject: The scene.
        episodes: The reference agent's episodes at seeds 0, 1, ….
    """
    reasons = list(family_faults(subject.pack, subject.solution))
    if reasons:
        return check("determined", reasons)
    weighed = [_weigh(subject, subject.draw(seed), episode) for seed, episode in enumerate(episodes)]
    for seed, found in enumerate(weighed):
        reasons += [f"seed {seed}: {fault}" for fault in (*found.faults, *_unsettled(subject, subject.draw(seed)))]
    return check(
        "determined",
        reasons,
        ambiguous_seeds=sum(found.survivors > 1 for found in weighed),
        reduced_chi_square=max(found.misfit for found in weighed),
        plausible_right=min(found.right for found in weighed),
    )


def _weigh(subject: Subject, draw: Draw, episode: Episode) -> _Weighed:
    """Compare the members of the family on the readings of an episode."""
    assert subject.solution.rivals is not None
    assert subject.solution.structure is not None
    fits, drawn = subject.solution.rivals(calls_and_readings(episode)), subject.solution.structure(draw.knobs)
    if drawn not in fits:
        return _Weighed([f"rivals has no member {drawn!r}, which was drawn"])
    if len({fit.readings for fit in fits.values()}) > 1:
        return _Weighed(["the members of rivals are fitted to different numbers of readings"])
    alive, misfit = surviving(fits), reduced_chi_square(fits[drawn])
    faults: list[str] = []
    if misfit > _LARGEST_MISFIT:
        faults.append(
            f"{drawn!r}, which was drawn, has a reduced chi-square of {misfit:.3g}: count the errors of the readings"
            " and of the computed values in full"
        )
    if drawn not in alive:
        faults.append(f"{drawn!r}, which was drawn, is excluded by {EXCLUDED_SIGMAS:g} standard deviations")
    shares = [_right_share(subject, draw, fits[name]) for name in alive]
    for name, share in zip(alive, shares, strict=True):
        if not subject.agrees(fits[name].answer, subject.truth(draw)):
            faults.append(
                f"{name!r} fits the readings as well as {drawn!r} (chi-square {fits[name].chi_square:.4g} and"
                f" {fits[drawn].chi_square:.4g} of {fits[drawn].readings} readings) and gives {fits[name].answer}; the"
                f" key is {subject.truth(draw)}"
            )
        elif share < _AGREEING_SHARE:
            faults.append(
                f"the readings leave the constants of {name!r} open: only {share:.0%} of the answers by plausible ones"
                f" agree with the key, at least {_AGREEING_SHARE:.0%} must"
            )
    return _Weighed(faults, len(alive), misfit, min(shares))


def _right_share(subject: Subject, draw: Draw, fit: Member) -> float:
    """Return the share of answers that agree with the key, for constants sampled from the distribution of the fit."""
    answers = fit.plausible(_PLAUSIBLE)
    return sum(subject.agrees(value, subject.truth(draw)) for value in answers) / len(answers)


def _unsettled(subject: Subject, draw: Draw) -> Iterator[str]:
    """Yield a sentence if the equilibrium is not a steady state in the engine, or if a disturbance does not decay."""
    if subject.solution.settles is None:
        return
    for off in (0.0, _OFF, -_OFF):
        left = subject.solution.settles(Engine(draw.mjcf), draw.knobs, off)
        allowed = _SHIFT + _LEFT * abs(off)
        if not abs(left) <= allowed:
            yield (
                f"let go {off:+.0%} off the asked state under constant loads, it ends {left:+.2%} off; at most"
                f" {allowed:.2%} may be left of a stable state"
            )


def family_faults(pack: Pack, solution: Solution) -> Iterator[str]:
    """Yield a sentence for each part that a pack with a family of laws must have and lacks."""
    task = pack.metadata.task
    if solution.rivals is None:
        yield "solution.py defines no rivals: fit each law of the family"
    if solution.structure is None:
        yield "solution.py defines no structure"
    if len(pack.family) < 2:
        yield "family names fewer than two laws: give the words in which the task states each"
    if not _STATED.search(task):
        yield 'the task states no family of laws: write "one of: first law; second law; or third law"'
    for name, words in pack.family.items():
        if words not in task:
            yield f"the task does not say {words!r}, the words of family.{name}"
    if _EQUILIBRIUM.search(_question(task)) and solution.settles is None:
        yield "the task asks for an equilibrium, but solution.py defines no settles: show that it is stable"


def _question(task: str) -> str:
    """Return the question in a task: the text from "Suppose" on, or the last two sentences."""
    supposed = task.rfind("Suppose")
    return task[supposed:] if supposed >= 0 else " ".join(re.split(r"(?<=[.?]) ", task)[-2:])
