"""Certificate 10: the reference plays with the stated instruments, within the stated limits, and needs them."""

from collections.abc import Iterator, Sequence
from statistics import median

from evaluator.certify.records import Check, check
from evaluator.certify.subject import Subject
from evaluator.records.episode import Episode
from evaluator.scores.experiment_cost import cost_of
from scenes import Pack

MOST_CALLS = 150
_NEEDED_SHARE = 0.5
"""Share of the calls and of the simulated time that the reference needs at least, so that they are scarce."""


def check_instrument(subject: Subject, episodes: Sequence[Episode]) -> Check:
    """Check that limits and instruments are stated, that the reference keeps them, and that it needs half of them.

    Args:
        subject: The scene.
        episodes: The reference agent's episodes at seeds 0, 1, ….
    """
    reasons = list(unstated(subject.pack))
    limits = subject.pack.limits
    assert limits is not None
    costs = [cost_of(episode, limits) for episode in episodes]
    calls, times = [cost.calls for cost in costs], [cost.lab_time_s for cost in costs]
    reasons += [
        f"seed {episode.key.seed}: the reference was refused: {exchange.text}"
        for episode in episodes
        for exchange in [exchange for turn in episode.turns for exchange in turn.exchanges if exchange.is_error][:1]
    ]
    if max(calls) > MOST_CALLS:
        reasons.append(f"the reference makes {max(calls)} calls; at most {MOST_CALLS} are allowed")
    for used, allowed, what in ((calls, limits.calls, "calls"), (times, limits.lab_time, "s of laboratory time")):
        if allowed is None:
            continue
        if max(used) > allowed * (1 + 1e-9):
            reasons.append(f"the reference uses {max(used):g} {what}, more than the limit of {allowed:g}")
        if median(used) < _NEEDED_SHARE * allowed:
            reasons.append(
                f"the reference uses {median(used):g} of {allowed:g} {what} on the median seed: lower the limit"
                " until it needs half"
            )
    return check("instrument", reasons, calls=median(calls), most_calls=max(calls), lab_time_s=float(median(times)))


def unstated(pack: Pack) -> Iterator[str]:
    """Yield a sentence for each limit and each resolution that a scene with predictions must state."""
    limits, instruments = pack.limits, pack.instruments
    for name in ("calls", "lab_time"):
        if getattr(limits, name, None) is None:
            yield f"limits.{name} is missing: say how far an agent may go"
    permissions = [pack.permissions_of(key) for key in pack.objects]
    angles = ("angle", any(may.angle for may in permissions)), ("spin", any(may.spin for may in permissions))
    for name in ("position", "velocity", *(name for name, shown in angles if shown)):
        if not getattr(instruments, name, 0.0):
            yield f"instruments.{name} is missing or 0: say how finely it is read"
