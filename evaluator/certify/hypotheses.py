"""Certificates 8 and 9: natural shortcuts give wrong answers, and the structure of the law has to be found."""

from collections import Counter
from collections.abc import Mapping, Sequence

from evaluator.agents.protocol_player import calls_and_readings
from evaluator.certify.records import Check, check
from evaluator.certify.shares import ENOUGH_SEEDS, at_least, at_most
from evaluator.certify.subject import Subject, gap
from evaluator.records.episode import Episode
from scenes.protocol import AnswerValue, Exchanges

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
    """Check that seeds draw several structures, and that only the right one explains what the reference reads.

    Args:
        subject: The scene.
        episodes: The reference agent's episodes at seeds 0, 1, ….
    """
    structure, fit = subject.solution.structure, subject.solution.fit
    if structure is None or fit is None:
        missing = [name for name in ("structure", "fit") if getattr(subject.solution, name) is None]
        return check("structure", [f"solution.py defines no {name}" for name in missing])
    reasons: list[str] = []
    # Labels cost nothing, so there are always enough of them.
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
    """Whether the model of a structure, fitted to calls and readings, gives the right answer at a seed."""
    assert subject.solution.fit is not None
    try:
        found = subject.solution.fit(exchanges, label)
    except Exception:  # noqa: BLE001 - a model that does not fit may fail in any way
        return False
    return subject.agrees(found, subject.truth(subject.draw(seed)))
