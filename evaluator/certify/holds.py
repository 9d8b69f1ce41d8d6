"""Certificate 11: each latch, catch, net, rim, guard or stop in the prompt holds against every allowed load.

A pack declares its catches. The certificate applies the loads of `loads` at every seed, and for longer at the seeds
whose apparatus responds most and least. After a load that engages a catch, further loads try to release the catch.
"""

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from evaluator.answers.engine import Engine
from evaluator.certify.catches import Watch, unknown_words
from evaluator.certify.loads import Attack, Pushes, attacks_on, handles_of, push, removals, take_away, unbounded_tools
from evaluator.certify.records import Check, check
from evaluator.certify.subject import Draw, Subject
from physment_mcp.contract.expressions import ExpressionError
from physment_mcp.errors import Unstable
from physment_mcp.session import MAX_SIMULATED_S
from scenes import Pack, PackError

_CANDIDATES = 100
"""Number of seeds among which those with the strongest and the weakest response to loads are searched."""
_EXTREME_SHARE = 3
"""Factor by which the loads act longer at these two seeds than at others."""
_WORK_US = 18e6
"""Estimated processor time of the certificate [µs]."""
_STEP_US, _LAW_US, _LOOK_US = 12.0, 8.0, 90.0
"""Estimated processor time of a stage of the integrator, of a law in it, and of a check of the state [µs]."""
_SEQUENCE = 7
"""Number of consecutive attacks in a run."""
_CHANGES = 70
"""Largest number of load changes in a run. An agent needs two of its 150 calls for each."""
_STRIDE = 7
"""Offset in the list of attacks between the first attacks of consecutive runs of a draw."""
_REASONS = 5
_LEAST_KG = 1e-9


def check_holds(subject: Subject, seeds: int, effort: float = 1.0) -> Check:
    """Check that each catch holds against the largest allowed loads, and that readings stay consistent.

    Args:
        subject: The scene.
        seeds: Number of seeds, from 0 on. Two more of the first hundred seeds, with the strongest and the weakest
            response to loads, are tested for longer.
        effort: Number of checked time steps, as a multiple of the default. The default takes about 20 s of processor
            time.
    """
    pack = subject.pack
    reasons = [f"{tool} is enabled: no limit bounds what it does" for tool in unbounded_tools(pack)]
    reasons += [f"no part of the prompt is named {word!r}" for word in unknown_words(pack)]
    if reasons:
        return check("holds", reasons)
    lightest, heaviest = _extremes(subject)
    draws = [(seed, 1) for seed in range(seeds)] + [(seed, _EXTREME_SHARE) for seed in (lightest, heaviest)]
    looks = effort * _looks_in_all(subject) / sum(share for _, share in draws)
    tally = _Tally([0] * len(pack.catches))
    try:
        reasons = _drive_all(subject, [(seed, round(share * looks)) for seed, share in draws], _SEQUENCE, tally)
        if not reasons and not all(tally.sprung):
            # Only a lasting load reaches a catch that is far away: one attack for the whole laboratory time.
            reasons = _drive_all(subject, [(seed, _most_looks(subject)) for seed, _ in draws], 1, tally)
    except (ExpressionError, PackError) as error:
        return check("holds", [f"field catches: {error}"])
    never = [catch.words[0] for catch, count in zip(pack.catches, tally.sprung, strict=True) if not count]
    reasons += [f"no load springs the {word}: its condition is never met" for word in never if not reasons]
    return check(
        "holds",
        reasons,
        loads=tally.loads,
        lab_time_s=tally.time_s,
        worst_share=tally.worst,
        lightest_seed=lightest,
        heaviest_seed=heaviest,
    )


def _extremes(subject: Subject) -> tuple[int, int]:
    """Return the seeds with the strongest and the weakest response to the largest loads."""
    responses: list[float] = []
    for seed in range(_CANDIDATES):
        try:
            responses.append(_response(Engine(subject.draw(seed).mjcf), subject.pack))
        except Unstable:
            responses.append(math.inf)
    return int(np.argmax(responses)), int(np.argmin(responses))


def _response(engine: Engine, pack: Pack) -> float:
    """Return the speeds that the largest loads cause; if only balls load a body, the inverse of the total mass."""
    handles = handles_of(engine, pack)
    return sum(handles.values()) if handles else 1 / max(sum(engine.mass(body) for body in engine.bodies), _LEAST_KG)


def _looks_in_all(subject: Subject) -> float:
    """Return the number of state checks that fit into `_WORK_US`, given the laws and the integrator's stages."""
    stages = 4 if 'integrator="RK4"' in subject.draw(0).mjcf else 1
    step = stages * (_STEP_US + _LAW_US * len(subject.pack.laws))
    return _WORK_US / (step + _LOOK_US)


@dataclass(slots=True)
class _Tally:
    """Totals over all runs."""

    sprung: list[int]
    """For each catch, the number of runs in which it acted."""
    loads: int = 0
    time_s: float = 0.0
    worst: float = 0.0
    """Largest distance of a bounded quantity from the middle of its bounds, divided by half their width."""

    def add(self, run: "_Run") -> None:
        """Add the totals of a run."""
        catches = run.watch.catches
        self.sprung = [count + catch.has_acted for count, catch in zip(self.sprung, catches, strict=True)]
        self.loads += len(run.history)
        self.time_s += run.engine.time
        self.worst = max(self.worst, run.watch.worst)


def _drive_all(subject: Subject, draws: Sequence[tuple[int, int]], in_a_row: int, tally: _Tally) -> list[str]:
    """Test seeds, given as (seed, number of state checks), with `in_a_row` attacks per run; returns faults.

    Raises:
        ExpressionError: A condition of a catch cannot be computed.
        PackError: A condition refers to an unknown name.
    """
    reasons: list[str] = []
    for number, (seed, looks) in enumerate(draws):
        try:
            reason = _drive(subject, subject.draw(seed), number, looks, in_a_row, tally)
        except Unstable:
            reason = "the engine becomes unstable in the first time steps under the largest load"
        reasons += [f"seed {seed}: {reason}"] if reason else []
        if len(reasons) == _REASONS:
            break
    return reasons


def _most_looks(subject: Subject) -> int:
    """Return the number of time steps in the laboratory time of the scene."""
    limits = subject.pack.limits
    return round(((limits and limits.lab_time) or MAX_SIMULATED_S) / Engine(subject.draw(0).mjcf).timestep)


def _drive(subject: Subject, draw: Draw, number: int, looks: int, in_a_row: int, tally: _Tally) -> str | None:
    """Test a seed with sequences of attacks; returns its faults."""
    start = Engine(draw.mjcf)
    attacks = attacks_on(list(handles_of(start, subject.pack)), start, subject.pack)
    removed = removals(start, subject.pack)
    most = _most_looks(subject)
    runs = max(1, math.ceil(looks / most))
    for run in range(runs):
        turn = number + run * _STRIDE
        watched = _Run(Engine(draw.mjcf), subject, draw, min(looks // runs, most), removed[turn % len(removed)])
        reason = watched.through(_sequence(attacks, turn, in_a_row))
        tally.add(watched)
        if reason:
            return reason
    return None


def _sequence(attacks: Sequence[Attack], turn: int, in_a_row: int) -> list[Attack]:
    """Return the attacks of one run, in order.

    Over all runs, each attack comes first once, and each pair of attacks occurs in direct succession.
    """
    first, pace = turn % len(attacks), turn // len(attacks) + 1
    return [attacks[(first + pace * place) % len(attacks)] for place in range(in_a_row)]


class _Run:
    """A run at one seed, in which attacks follow one another as in one episode of an agent."""

    def __init__(self, engine: Engine, subject: Subject, draw: Draw, looks: int, removed: Sequence[str]) -> None:
        for body in removed:
            engine.remove(body)
        self.engine, self.watch, self.left = engine, Watch(subject, draw, engine), looks
        self.history: list[str] = [f"{body} deleted" for body in removed]
        self._made, self._limits = 0.0, subject.pack.limits
        self._pushes: Pushes = {}
        self._changes = 0

    def through(self, sequence: Sequence[Attack]) -> str | None:
        """Apply each attack for an equal share of the time. If an attack engages a catch, the reversed attack follows.

        Returns:
            A fault, or None.
        """
        pending = deque(sequence)
        while pending and self.left > 0:
            attack, acted = pending.popleft(), self.watch.acted
            self._begin(attack)
            for _ in range(max(1, self.left // (len(pending) + 1))):
                if reason := self._look(attack):
                    return f"{reason}; loads: {', '.join(self.history)}"
                if self.watch.acted > acted:
                    pending.appendleft(attack.reversed())
                    break
        return None

    def _begin(self, attack: Attack) -> None:
        take_away(self.engine)
        self.history.append(f"{attack.name} from {self.engine.time:g} s")
        most = (self._limits and self._limits.created_mass) or 0.0
        if attack.ball is not None and self._made + attack.ball.mass <= most and attack.ball.put(self.engine):
            self._made += attack.ball.mass
        released = {of: np.zeros(3) for of in self._pushes}
        self._set({**released, **attack.pushes(self.engine)})

    def _look(self, attack: Attack) -> str | None:
        """Advance one time step under the attack; returns a fault or None."""
        if attack.way != "constant" and self._changes < _CHANGES:
            self._set(attack.pushes(self.engine))
        self.left -= 1
        try:
            self.engine.step(1)
        except Unstable:
            return f"the engine becomes unstable at {self.engine.time:g} s"
        reason = self.watch.look()
        return reason and f"{reason} at {self.engine.time:g} s"

    def _set(self, pushes: Pushes) -> None:
        changed = {
            of: load for of, load in pushes.items() if not np.array_equal(load, self._pushes.get(of, np.zeros(3)))
        }
        self._changes += bool(changed)
        self._pushes = {**self._pushes, **pushes}
        if changed:
            push(self.engine, changed)
