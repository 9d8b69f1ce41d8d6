"""Finds the terms of a law from pushes and readings, by a beam search over the structures of the grammar.

A step of the search adds a part, removes a part, replaces one, or replaces two terms by one. The score test selects the
changes that are worth a fit: it computes how much of the residuals a term explains beyond the constants of the law, for
many values of its constants at once. Structures are fitted leg by leg (`weak_form`). They are compared by their
evidence, which penalises constants and parts.
"""

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from threading import Event

import numpy as np

from scenes.fitting import Array, refined
from scenes.worlds.candidates import PART, Candidates, Fit, Offer, changed, expected_gain, plainer
from scenes.worlds.catalogue import forms_of, modulations_of
from scenes.worlds.course_fits import fit_at, on_course
from scenes.worlds.parts import Form, Modulation
from scenes.worlds.terms import Structure, Term
from scenes.worlds.weak_form import Legs, Whitened

_ROUNDS, _REFITTED = 8, 2
"""Iterations of a fit, and those of a law without a part, before another part is chosen in its place."""
_OFFERS, _SWAPPED, _MERGED = 10, 6, 3
"""Number of candidates for an addition, for the replacement of a term or modulation, and for that of two terms."""
_FITTED, _ENOUGH = 16, 5
"""Number of neighbours of a structure that are fitted, and number after which a better one ends the expansion."""
_BARRED, _NARROW = 0.6, 2
"""Share of the forms that a restart excludes, and its beam width."""
_PLAIN = 0.5
"""Share of the restarts that begin without modulations."""
_AGREED = 3
"""Number of consecutive restarts that must find no better structure."""
_DEVIATIONS = 1.0
"""Largest excess of chi-square over its expected value, in standard deviations, of a fit that explains the readings."""
_REPEATED = 2 * PART
"""Penalty of a structure that has a modulation twice, which the grammar does not draw."""
_TOLD = 2
"""Number of times that the path is smoothed if the structure is known."""
_POINTS, _STARTS, _TRIES = 400, 8, 4
"""For a structure with unknown constants: number of sampled points, number of them that are fitted, and number of
repetitions."""
_LEAST_DRIFT, _MOST_DRIFT = 0.2, 0.4
"""Smallest model error in a search, in standard deviations of a reading, because transitions neglect hidden states; and
largest model error of a fit that explains the readings."""


@dataclass
class Search:
    """A search for the terms that explain readings.

    Attributes:
        legs: The pushes and readings, by legs.
        width: Beam width.
        seconds: Processor time of the calling thread after which the search stops [s].
        forms: Forms that may occur; None for all of the apparatus.
        modulations: Modulations that may occur; None for all of the apparatus.
        seed: Seed of sampled constants.
        halted: Event by which another thread stops the search.
    """

    legs: Legs
    width: int = 5
    seconds: float = 120.0
    forms: Sequence[Form] | None = None
    modulations: Sequence[Modulation] | None = None
    seed: int = 0
    halted: Event = field(default_factory=Event)
    about: tuple[Structure, Array] | None = None
    """Law from which the transitions of the first fits are computed; None for a law without terms."""
    whitened: Whitened = field(init=False)
    """The whitened legs, to which structures are fitted."""
    found: dict[Structure, Fit] = field(default_factory=dict[Structure, Fit])
    """All structures fitted since the last linearisation, each with its best fit."""
    tried: int = 0
    """Number of fits."""

    def __post_init__(self) -> None:
        self._rng, self._begun = np.random.default_rng(self.seed), time.thread_time()
        bare = Structure(self.legs.told.apparatus, (), self.legs.told.radius)
        self._bare = bare, np.full(bare.bodies, 0.5)
        self._about(self.legs, *(self.about or self._bare))

    def run(self) -> list[Fit]:
        """Run the search; returns the fitted structures of the grammar, best first.

        The search starts without modulations, because a wrong form with a modulation often hides the right form. It
        restarts without some parts of the best structure until several restarts in a row find no better one, and as
        long as the best structure does not explain the readings, leg by leg and in sequence. Every second restart, from
        the first on, also exchanges several parts at once.
        """
        plain = frozenset(part.name for part in self._candidates.factors)
        self._descend([self.fit(*self._bare, 4)], self.width, plain, settle=True)
        self._descend(self.best(), self.width, frozenset(), settle=True)
        agreed, wide = 0, False
        while not (agreed >= _AGREED and self.explained and self.is_confirmed()) and not self.over:
            before, wide = self.best()[0], not wide
            self._again(0.25)
            barred = frozenset(term.form for term in before.structure.terms if self._rng.random() < _BARRED)
            barred |= plain if self._rng.random() < _PLAIN else frozenset()
            self._descend([self.fit(*self._bare, 4)], _NARROW, barred, settle=False, wide=wide)
            self._descend(self.best(), self.width, frozenset(), settle=True, wide=wide)
            agreed = agreed + 1 if self.best()[0].structure == before.structure else 0
        return [fit for fit in self.best() if not fit.structure.repeats] or self.best()

    def tell(self, structure: Structure, unit: Array) -> Fit:
        """Start the search from a known structure with approximate constants; returns its fit."""
        for _ in range(_TOLD):
            self._about(self.legs, structure, unit)
            fit = self.fit(structure, unit, _ROUNDS)
            unit = fit.unit
            self._again(1.0)
        return self.found[structure]

    def solve(self, structure: Structure) -> Fit:
        """Fit a known structure with unknown constants: sample many points, refine the best, then proceed as `tell`."""
        for _ in range(_TRIES):
            units = self._rng.random((len(structure.ranges), _POINTS))
            costs = (self.whitened.misfits(structure, units) ** 2).sum(axis=0)
            for at in np.argsort(costs)[:_STARTS]:
                self.fit(structure, units[:, at], _ROUNDS)
            self.tell(structure, self.found[structure].unit)
            if self.explained:
                break
        return self.found[structure]

    def extend(self, parts: int) -> None:
        """Add at most `parts` parts to the best structure, one after the other, by a greedy search."""
        for _ in range(parts):
            for structure, unit in self._candidates.more(self.best()[0], frozenset(), 2 * _OFFERS):
                self.fit(structure, unit, _ROUNDS)
            self._again(1.0)

    def _descend(
        self, roots: Sequence[Fit], width: int, barred: frozenset[str], *, settle: bool, wide: bool = False
    ) -> None:
        """Modify the best structures of a pool until no better one is found.

        Args:
            roots: The pool.
            width: Beam width.
            barred: Names of excluded forms and modulations.
            settle: Whether to linearise around the path of a structure that is clearly better.
            wide: Whether a modification may exchange several parts, as `promising` describes.
        """
        pool: dict[Structure, Fit] = {fit.structure: fit for fit in roots}
        expanded = set[Structure]()
        while not self.over:
            best = sorted(pool.values(), key=_score)
            node = next((fit for fit in best[:width] if fit.structure not in expanded), None)
            if node is None:
                return
            expanded.add(node.structure)
            for number, (structure, unit) in enumerate(self.promising(node, barred, wide=wide)):
                if self.over or (number >= _ENOUGH and min(map(_score, pool.values())) < node.score - PART):
                    break
                known = self.found.get(structure)
                if known is None or structure == node.structure:  # the structure may fit better around the new path
                    self.fit(structure, unit, _ROUNDS)
                pool[structure] = self.found[structure]
            if min(map(_score, pool.values())) < best[0].score - PART and settle:
                self._again(1.0)
                pool = {structure: self.found[structure] for structure in pool if structure in self.found}

    @property
    def explained(self) -> bool:
        """Return whether a structure of the grammar is best and explains the readings almost without model error."""
        best = self.best()[0]
        near = _explains(best, self.legs.course.count)
        return near and self.legs.drift < _MOST_DRIFT and not best.structure.repeats

    def is_confirmed(self) -> bool:
        """Fit the best structure to all legs in sequence; returns whether it explains the readings in this fit, too.

        A fit leg by leg may explain readings by a model error that is small in every leg but has the same sign in many.
        """
        fit = on_course(self.legs.course, self.legs.told, self.best()[0])
        return _explains(fit, max(self.legs.course.count - len(fit.unit), 1))

    @property
    def over(self) -> bool:
        """Whether the processor time of the search is used up, or another thread stopped it."""
        return self.halted.is_set() or time.thread_time() - self._begun > self.seconds

    def best(self) -> list[Fit]:
        """Return all fitted structures, best first."""
        return sorted(self.found.values(), key=_score)

    def fit(self, structure: Structure, unit: Array, rounds: int) -> Fit:
        """Fit a structure from a point, and store the fit if it is the best one of the structure."""
        self.tried += 1
        fit = self._refined(structure, unit, rounds)
        if structure not in self.found or fit.score < self.found[structure].score:
            self.found[structure] = fit
        return fit

    def _refined(self, structure: Structure, unit: Array, rounds: int) -> Fit:
        """Fit a structure from a point."""
        misfits = partial(self.whitened.misfits, structure)
        return fit_at(structure, refined(misfits, np.clip(unit, -0.1, 1.1), rounds), misfits)

    def _fitted(self, structure: Structure, unit: Array) -> Fit:
        """Return the fit object of a structure at given constants, without optimising them."""
        return fit_at(structure, unit, partial(self.whitened.misfits, structure))

    def _about(self, legs: Legs, structure: Structure, unit: Array) -> None:
        """Linearise the legs around a path; a law gives the change of each leg's end with its start."""
        apparatus = legs.told.apparatus
        self.legs, self.whitened = legs, legs.about(structure, unit)
        self._candidates = Candidates(
            self.whitened,
            forms_of(apparatus) if self.forms is None else self.forms,
            modulations_of(apparatus) if self.modulations is None else self.modulations,
            self._rng,
        )

    def _again(self, share: float) -> None:
        """Refit the best structures around the most likely path of the best one, and discard the others.

        Args:
            share: Fraction of the model error to keep.
        """
        best = self.best()[: 4 * self.width]
        legs = self.whitened.smoothed(best[0].structure, best[0].unit)
        self._about(replace(legs, drift=max(_LEAST_DRIFT, share * legs.drift)), best[0].structure, best[0].unit)
        self.found = {}
        for fit in best:
            self.fit(fit.structure, fit.unit, 4)

    def promising(self, node: Fit, barred: frozenset[str], *, wide: bool = False) -> list[tuple[Structure, Array]]:
        """Return the neighbours with the best expected scores, the best first.

        A neighbour has one part more or less, or another term in place of one.

        Args:
            node: A fit.
            barred: Names of excluded forms and modulations.
            wide: Whether neighbours may also have another modulation or form in place of one, or a term in place of
                two, and a modulation twice. Without the last, a modulation that a wrong term has could not be added to
                the right one; structures of the grammar have each modulation once. The law without a part is then
                refitted before another part is chosen, because the score test is accurate only for small residuals.
        """
        parts, propose, rounds = node.parts(), self._candidates, _REFITTED if wide else 0

        def shut(fit: Fit) -> frozenset[str]:
            return barred if wide else barred | fit.structure.modulations

        def without(kept: Sequence[tuple[Term, Array]]) -> Fit:
            return self._refined(*changed(node, kept), rounds)

        offers = propose.offers(node, shut(node))[:_OFFERS]
        found = [(node.score - gain, structure, start) for gain, structure, start in offers]
        for at, (term, unit) in enumerate(parts):
            rest = parts[:at] + parts[at + 1 :]
            for number in range(len(term.modulations)):
                less = without([*rest, plainer(term, unit, number)])
                found += _instead(less, propose.modulations(less, barred)[:_SWAPPED] if wide else ())
            less = without(rest)
            found += _instead(less, propose.offers(less, shut(less))[:_SWAPPED])
            if wide:
                found += _instead(less, propose.other_forms(less, term, unit, barred)[:_SWAPPED])
                for other in range(at):
                    fewer = self._fitted(*changed(node, rest[:other] + rest[other + 1 :]))
                    found += _instead(fewer, propose.terms(fewer, barred)[:_MERGED])
        different = dict[Structure, Array]()
        for _, structure, start in sorted(found, key=lambda offer: offer[0]):
            if structure != node.structure:
                different.setdefault(structure, start)
        return list(different.items())[:_FITTED]

    def neighbours(self, node: Fit) -> Iterator[tuple[Structure, Array]]:
        """Return structures with a part added, removed or replaced, each with initial constants.

        Of the additions and replacements, only those that the score test ranks highest are returned. The certificates
        of published worlds depend on this choice; `all_neighbours` returns all.
        """
        parts = node.parts()
        yield from self._candidates.more(node, frozenset(), _OFFERS)
        for at, (term, unit) in enumerate(parts):
            rest = parts[:at] + parts[at + 1 :]
            for number in range(len(term.modulations)):
                yield changed(node, [*rest, plainer(term, unit, number)])
            less = changed(node, rest)
            yield from self._candidates.more(self._fitted(*less), frozenset(), _SWAPPED)
            yield less

    def all_neighbours(self, node: Fit) -> Iterator[tuple[Structure, Array]]:
        """Return all structures that differ from a fitted one by one part, some of them twice, with initial constants.

        A part is a form, alone or with one modulation, or a modulation. It is added, removed or replaced.
        """
        parts, propose = node.parts(), self._candidates
        offers = propose.offers(node, node.structure.modulations)
        for at, (term, unit) in enumerate(parts):
            rest = parts[:at] + parts[at + 1 :]
            for number in range(len(term.modulations)):
                less = self._fitted(*changed(node, [*rest, plainer(term, unit, number)]))
                offers += [(0.0, less.structure, less.unit), *propose.modulations(less, less.structure.modulations)]
            less = self._fitted(*changed(node, rest))
            offers += [(0.0, less.structure, less.unit), *propose.offers(less, less.structure.modulations)]
            offers += propose.other_forms(less, term, unit, frozenset())
        yield from ((structure, start) for _, structure, start in offers if structure != node.structure)


def _instead(less: Fit, offers: Sequence[Offer]) -> list[Offer]:
    """Return a structure that lacks a part, and those with another part in its place, with their expected scores."""
    score = less.score - expected_gain(less)
    return [(score, less.structure, less.unit), *((score - gain, added, unit) for gain, added, unit in offers)]


def _explains(fit: Fit, freedom: int) -> bool:
    """Return whether chi-square is at most slightly above its expected value, the number of degrees of freedom."""
    return fit.chi_square < freedom + _DEVIATIONS * float(np.sqrt(2 * freedom))


def _score(fit: Fit) -> float:
    """Return the score, with a penalty for a modulation that occurs twice."""
    return fit.score + (_REPEATED if fit.structure.repeats else 0.0)
