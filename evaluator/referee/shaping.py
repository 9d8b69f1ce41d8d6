"""Shaping rewards: how much each call lowers the Cramér-Rao bound of the answer. Independent of HTTP and servers."""

import math
from itertools import pairwise
from pathlib import Path

from evaluator.certify.evidence import measured
from evaluator.certify.subject import Subject
from evaluator.records.episode import Episode
from evaluator.records.run import SeedOf
from scenes import PackError, find_pack

_LEAST, _MOST = 1e-3, 1e2
"""Bounds of the answer's standard error are clipped to this range [tolerances]."""


def shaping_of(episode: Episode, seed_of: SeedOf, folder: Path | None) -> list[float] | None:
    """Return a shaping reward for each call of an episode, refused ones and the answer included.

    The potential of a state is -ln(b), where b is the largest Cramér-Rao bound of the answer in tolerances, and 100
    before the first reading. The reward of a call is the change of the potential. The sum of all changes is subtracted
    from the reward of the last call, so the rewards add up to 0. Without discounting, such rewards change no optimal
    policy (Ng, Harada and Russell 1999).

    Args:
        episode: The ended episode.
        seed_of: Function that returns the seed of a recorded scene and seed.
        folder: Folder of packs; None for the suite.

    Returns:
        The rewards; None if the evidence of the episode is not measurable.
    """
    try:
        subject = Subject.open(find_pack(episode.key.scene, folder))
    except PackError:
        return None
    evidence = measured(subject, seed_of(episode.key.scene, episode.key.seed), episode, "", fit_rivals=False)
    if evidence.not_measurable:
        return None
    bounds = {step.call: step.worst_bound for step in evidence.calls}
    accepted = {id(exchange): number for number, (_, exchange) in enumerate(episode.accepted_calls(), start=1)}
    potentials = [_potential(_MOST)]
    for turn in episode.turns:
        for exchange in turn.exchanges:
            bound = bounds.get(accepted.get(id(exchange), 0))
            potentials.append(potentials[-1] if bound is None else _potential(bound))
    rewards = [after - before for before, after in pairwise(potentials)]
    return [*rewards[:-1], rewards[-1] - sum(rewards)] if rewards else []


def _potential(bound: float) -> float:
    return -math.log(min(max(bound, _LEAST), _MOST))
