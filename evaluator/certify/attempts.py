"""Certificates 7, 8 and 9: naive attempts fail, shortcuts mislead, and the structure of the law must be identified.

A shortcut is a plausible but wrong method that the pack lists.
"""

import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence

from evaluator.agents.attackers.strategies import ATTACKERS
from evaluator.agents.reference import calls_and_readings
from evaluator.certify.difficulty import Drive, drive
from evaluator.certify.records import Check, check
from evaluator.certify.subject import Subject, gap
from evaluator.records.episode import Episode
from scenes.protocol import AnswerValue, Exchanges, Protocol

ENOUGH_SEEDS = 20
"""Smallest number of seeds for which `at_most` and `at_least` use the exact share."""
_ROUNDING = 1e-9


def at_most(share: float, of: int, seeds: int) -> int:
    """Convert an upper limit on the share of seeds to the largest allowed number of seeds.

    Args:
        share: Limit, from 0 to 1.
        of: Number of seeds that the share refers to.
        seeds: Number of seeds on which the scene is certified.
    """
    return math.floor(share * of + _ROUNDING) if seeds >= ENOUGH_SEEDS else math.ceil(share * of - _ROUNDING)


def at_least(share: float, of: int, seeds: int) -> int:
    """Convert a lower limit on the share of seeds to the smallest allowed number; arguments as for `at_most`."""
    return math.ceil(share * of - _ROUNDING) if seeds >= ENOUGH_SEEDS else math.floor(share * of + _ROUNDING)


BATCH_CALLS = 60
"""Largest number of calls of `batch`, without its answer."""
_BATCH_SHARE, _ATTACKER_SHARE, _ABOVE_CHANCE = 1 / 3, 0.20, 0.10


async def check_unstageable(subject: Subject, seeds: int) -> Check:
    """Check that direct attempts, one fixed batch of calls, and the attackers do not find the answer.

    A direct attempt sets up the situation of the question and reads the result.

    Args:
        subject: The scene.
        seeds: Number of seeds, from 0 on.
    """
    reasons: list[str] = []
    figures: dict[str, float] = {}
    if not subject.solution.stages:
        reasons.append("solution.py defines no stage: write the most direct attempt to bring about what is asked")
    for name, stage in subject.solution.stages.items():
        attempts = await _attempts(subject, seeds, stage)
        reasons += _stage_faults(subject, name, attempts)
        figures[f"{name}_refused"] = sum(bool(attempt.refusals) for attempt in attempts)
    if subject.solution.batch is None:
        reasons.append("solution.py defines no batch: write the best attempt with one fixed list of calls")
    else:
        attempts = await _attempts(subject, seeds, subject.solution.batch)
        figures["batch_right"] = right = _right(subject, attempts)
        reasons += _batch_faults(attempts)
        if right > at_most(_BATCH_SHARE, seeds, seeds):
            reasons.append(f"batch is right on {right} of {seeds} seeds; at most a third may be")
    options = subject.spec.options
    share = 1 / len(options) + _ABOVE_CHANCE if options else _ATTACKER_SHARE
    for name, attack in ATTACKERS.items():
        figures[f"{name}_right"] = right = _right(subject, await _attempts(subject, seeds, attack))
        if right > at_most(share, seeds, seeds):
            reasons.append(f"the attacker {name} is right on {right} of {seeds} seeds; at most {share:.0%} may be")
    return check("unstageable", reasons, **figures)


async def _attempts(subject: Subject, seeds: int, protocol: Callable[[str], Protocol]) -> list[Drive]:
    return [await drive(subject.session(subject.draw(seed)), protocol) for seed in range(seeds)]


def _is_right(subject: Subject, attempt: Drive, seed: int) -> bool:
    return not attempt.failure and subject.agrees(attempt.answer, subject.truth(subject.draw(seed)))


def _right(subject: Subject, attempts: list[Drive]) -> int:
    return sum(_is_right(subject, attempt, seed) for seed, attempt in enumerate(attempts))


def _stage_faults(subject: Subject, name: str, attempts: list[Drive]) -> list[str]:
    """Report the first seed on which a direct attempt is correct, or fails with an unrelated error."""
    for seed, attempt in enumerate(attempts):
        if _is_right(subject, attempt, seed):
            return [f"{name} is right at seed {seed}: what is asked can be brought about in the laboratory"]
        if attempt.failure and not attempt.refusals:
            return [f"{name} fails at seed {seed}, although nothing was refused: {attempt.failure}"]
    return []


def _batch_faults(attempts: list[Drive]) -> list[str]:
    for seed, attempt in enumerate(attempts):
        if attempt.failure:
            return [f"batch fails at seed {seed}: {attempt.failure}"]
        if attempt.iterations != 2 or len(attempt.calls) - 1 > BATCH_CALLS:
            return [
                f"batch makes {len(attempt.calls) - 1} calls in {attempt.iterations - 1} iterations before its answer;"
                f" it is one iteration of at most {BATCH_CALLS} calls"
            ]
    return []


_OFF = 0.10
"""Relative error above which a shortcut is misleading."""
_MISLED_SHARE = 2 / 3
_STRUCTURES, _COMMONEST_SHARE = 3, 0.5
_MISFIT_SHARE, _FIT_SHARE = 0.5, 0.8


def check_tempting(subject: Subject, seeds: int) -> Check:
    """Check that each shortcut misses the key by more than 10 % on two thirds of the seeds.

    Args:
        subject: The scene.
        seeds: Number of seeds, from 0 on.
    """
    naive = subject.solution.naive
    if naive is None:
        return check("tempting", ["solution.py defines no naive: write the answer of each natural shortcut"])
    draws = [subject.draw(seed) for seed in range(seeds)]
    answers: list[Mapping[str, AnswerValue]] = [naive(draw.knobs) for draw in draws]
    names = list(dict.fromkeys(name for values in answers for name in values))
    reasons = [] if names else ["naive gives no answer: at least one natural shortcut is needed"]
    figures: dict[str, float] = {}
    for name in names:
        keyed = [
            (values[name], subject.truth(draw)) for values, draw in zip(answers, draws, strict=True) if name in values
        ]
        figures[f"{name}_off"] = off = sum(_misses(subject, value, key) for value, key in keyed)
        if off < at_least(_MISLED_SHARE, seeds, seeds):
            reasons.append(
                f"the shortcut {name!r} misses by more than 10 % on only {off} of {seeds} seeds: at least two thirds"
            )
    return check("tempting", reasons, **figures)


def _misses(subject: Subject, value: AnswerValue, key: AnswerValue) -> bool:
    if subject.spec.options:
        return not subject.agrees(value, key)
    return gap(value, key) > _OFF and not subject.agrees(value, key)


def check_structure(subject: Subject, episodes: Sequence[Episode]) -> Check:
    """Check that the law's structure differs between seeds, and that only the correct one explains the readings.

    Args:
        subject: The scene.
        episodes: The reference agent's episodes at seeds 0, 1, ….
    """
    structure, fit = subject.solution.structure, subject.solution.fit
    if structure is None or fit is None:
        missing = [name for name in ("structure", "fit") if getattr(subject.solution, name) is None]
        return check("structure", [f"solution.py defines no {name}" for name in missing])
    reasons: list[str] = []
    # Drawing a structure is cheap, so at least ENOUGH_SEEDS are drawn.
    labels = [structure(subject.draw(seed).knobs) for seed in range(max(ENOUGH_SEEDS, len(episodes)))]
    commonest, most = Counter(labels).most_common(1)[0]
    if len(set(labels)) < _STRUCTURES:
        reasons.append(
            f"{len(labels)} seeds draw only {len(set(labels))} structures; at least {_STRUCTURES} are needed"
        )
    if most > at_most(_COMMONEST_SHARE, len(labels), len(labels)):
        reasons.append(
            f"the structure {commonest!r} is drawn on {most} of {len(labels)} seeds; at most half may have one"
        )
    others = misfits = fits = 0
    for seed, episode in enumerate(episodes):
        exchanges = calls_and_readings(episode)
        fits += _explains(subject, seed, exchanges, labels[seed])
        if labels[seed] != commonest:
            others += 1
            misfits += not _explains(subject, seed, exchanges, commonest)
    seeds = len(episodes)
    if misfits < at_least(_MISFIT_SHARE, others, seeds):
        reasons.append(
            f"the model of {commonest!r}, fitted to what the reference reads, is wrong on only {misfits} of the"
            f" {others} seeds with another structure: at least half"
        )
    if fits < at_least(_FIT_SHARE, seeds, seeds):
        reasons.append(f"fit with the true structure is right on only {fits} of {seeds} seeds: at least 80 %")
    return check(
        "structure",
        reasons,
        structures=sorted(set(labels)),
        commonest_on=most,
        misfits=misfits,
        others=others,
        fits=fits,
    )


def _explains(subject: Subject, seed: int, exchanges: Exchanges, label: str) -> bool:
    """Return whether a structure of the law, fitted to calls and readings, gives the right answer at a seed."""
    assert subject.solution.fit is not None
    try:
        found = subject.solution.fit(exchanges, label)
    except Exception:  # noqa: BLE001 - a model that does not fit may fail in any way
        return False
    return subject.agrees(found, subject.truth(subject.draw(seed)))
