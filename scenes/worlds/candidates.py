"""Ranks the parts that could be added to a law, by the score test on the residuals of the law.

Constants are sampled for each form of the grammar, alone and with each modulation, and `weak_form` computes the effect
of the term on each leg. The score of a term is the decrease of chi-square in a linear fit of the term and all constants
of the law.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scenes.fitting import Array
from scenes.worlds.drawing import compatible
from scenes.worlds.parts import DISC, RATIO, Form, Modulation, Range
from scenes.worlds.terms import Structure, Term
from scenes.worlds.weak_form import Whitened, named, to_unit, to_value

PART = 7.0
"""Decrease of chi-square that a form or modulation needs beyond its constants' penalty, because many are tested."""
_CONSTANT = 4.0
"""Penalty of a constant in the score test."""
_SAMPLES = (40, 160)
"""Number of samples of a term's constants: for each constant except its magnitude, and in total at most."""
_MODULATIONS = 2
"""Largest number of modulations of a term."""
_TINY = 1e-9


@dataclass(frozen=True)
class Fit:
    """A structure with its best-fit constants."""

    structure: Structure
    unit: Array
    """The constants, as a point of the unit cube."""
    chi_square: float
    """Sum of the squared misfits."""
    score: float
    """Minus twice the logarithm of the evidence, up to a constant."""
    misfits: Array
    slope: Array
    """Derivatives of the misfits with respect to the constants."""

    def parts(self) -> list[tuple[Term, Array]]:
        """Return the terms with the points of their constants."""
        found: list[tuple[Term, Array]] = []
        at = self.structure.bodies
        for term in self.structure.terms:
            size = len(term.ranges(0))
            found.append((term, self.unit[at : at + size]))
            at += size
        return found

    @property
    def masses(self) -> Array:
        """The points of the masses."""
        return self.unit[: self.structure.bodies]


def expected_gain(fit: Fit) -> float:
    """Return by how much a fit is expected to decrease chi-square, if its misfits are linear in its constants."""
    basis = np.linalg.qr(fit.slope)[0]
    return float(((basis.T @ fit.misfits) ** 2).sum())


def score_of(structure: Structure, misfits: Array, slope: Array) -> float:
    """Return minus twice the log evidence of a structure (Laplace approximation), up to a constant."""
    count = sum(1 + len(term.modulations) for term in structure.terms)
    return float(misfits @ misfits + np.linalg.slogdet(slope.T @ slope / (2 * math.pi))[1]) + PART * count


Offer = tuple[float, Structure, Array]
"""Expected decrease of the score, a structure with one more part, and its initial point of the unit cube."""


@dataclass
class _Library:
    """Effects of terms with sampled constants on each leg; an entry for each form alone and with each modulation."""

    terms: list[Term]
    units: list[Array]
    """Sampled constants of each term; a column for each sample."""
    entry: NDArray[np.int_]
    """Index of the entry to which each column belongs."""
    sample: NDArray[np.int_]
    columns: Array
    """Whitened changes of the ends of the legs, for a term of magnitude 1."""


@dataclass
class Candidates:
    """Proposes terms and modulations to add to laws, from the residuals of a fixed set of legs.

    Attributes:
        whitened: The legs.
        forms: Forms that may occur.
        factors: Modulations that may occur.
        rng: Source of sampled constants.
    """

    whitened: Whitened
    forms: Sequence[Form]
    factors: Sequence[Modulation]
    rng: np.random.Generator
    _kept: dict[str, _Library] = field(default_factory=dict[str, _Library])

    def more(self, node: Fit, barred: frozenset[str], most: int) -> list[tuple[Structure, Array]]:
        """Return the structures with one more term or modulation that have the highest scores.

        Like the structures of the grammar, they have each modulation at most once.
        """
        shut = barred | node.structure.modulations
        return [(structure, unit) for _, structure, unit in self.offers(node, shut)[:most]]

    def offers(self, node: Fit, barred: frozenset[str]) -> list[Offer]:
        """Return the structures with one more term or modulation, by descending score."""
        return sorted([*self._terms(node, barred), *self._modulations(node, barred)], key=_by_score)

    def terms(self, node: Fit, barred: frozenset[str]) -> list[Offer]:
        """Return the structures with one more term, by descending score."""
        return sorted(self._terms(node, barred), key=_by_score)

    def modulations(self, node: Fit, barred: frozenset[str]) -> list[Offer]:
        """Return the structures with one more modulation, by descending score."""
        return sorted(self._modulations(node, barred), key=_by_score)

    def other_forms(self, less: Fit, term: Term, unit: Array, barred: frozenset[str]) -> list[Offer]:
        """Return the structures with another form in place of a term's, by descending score; modulations are kept.

        Args:
            less: The fit without the term.
            term: A term with modulations. Those without are in `terms`.
            unit: Its constants, as a point of the unit cube.
            barred: As in `offers`.
        """
        return sorted(self._other_forms(less, term, unit, barred), key=_by_score) if term.modulations else []

    def _other_forms(self, less: Fit, term: Term, unit: Array, barred: frozenset[str]) -> Iterator[Offer]:
        constants, kept = named(less.structure, less.unit[:, None]), unit[len(term.kind.constants) :]
        there = [one.kind for one in less.structure.terms]
        suited = (form for form in self.forms if all(form.group in part.fits for part in term.factors))
        for form in suited:
            if form.name in barred | {term.form} or not compatible(less.structure.apparatus, [*there, form]):
                continue
            other = Term(form.name, term.modulations)
            samples = self._samples(len(form.constants))
            fresh = [_sampled(bounds, samples, self.rng) for bounds in form.constants.values()]
            units = np.vstack([*fresh, np.repeat(kept[:, None], samples, axis=1)])
            values = _values(other, units)
            if _linear(form):
                values[next(iter(values))] = np.ones(samples)
            columns = self.whitened.matrix @ self._column(other, constants, values, samples)
            gains, sizes = self._gains(less, columns, np.array(_limits(form)))
            best = int(np.argmax(gains))
            units[0, best] = to_unit(_size(form), sizes[best]) if _linear(form) else units[0, best]
            price = _CONSTANT * len(units) + PART * (1 + len(term.modulations))
            yield float(gains[best]) - price, *changed(less, [*less.parts(), (other, units[:, best])])

    def _terms(self, node: Fit, barred: frozenset[str]) -> Iterator[Offer]:
        """Return terms to add, with their scores."""
        library, parts = self._columns(node), node.parts()
        limits = np.array([_limits(term.kind) for term in library.terms])[library.entry]
        gains, sizes = self._gains(node, library.columns, limits)
        forms = [term.kind for term in node.structure.terms]
        for entry, term in enumerate(library.terms):
            if barred & {term.form, *term.modulations} or not compatible(node.structure.apparatus, [*forms, term.kind]):
                continue
            columns = np.flatnonzero(library.entry == entry)
            at = columns[int(np.argmax(gains[columns]))]
            unit = library.units[entry][:, library.sample[at]].copy()
            if _linear(term.kind):
                unit[0] = to_unit(_size(term.kind), sizes[at])
            price = _CONSTANT * len(unit) + PART * (1 + len(term.modulations))
            yield float(gains[at]) - price, *changed(node, [*parts, (term, unit)])

    def _modulations(self, node: Fit, barred: frozenset[str]) -> Iterator[Offer]:
        """Return modulations to add to a term, with their scores."""
        parts = node.parts()
        constants = named(node.structure, node.unit[:, None])
        for at, (term, unit) in enumerate(parts):
            if len(term.modulations) >= _MODULATIONS:
                continue
            for part in self.factors:
                if part.name in barred.union(term.modulations) or term.kind.group not in part.fits:
                    continue
                names = (*term.modulations, part.name)
                more = Term(term.form, tuple(sorted(names)))
                samples = self._samples(len(part.constants))
                fresh = np.column_stack([_sampled(b, samples, self.rng) for b in part.constants.values()]).T
                units = _with_modulation(term, unit, part.name, fresh)
                columns = self._column(more, constants, _values(more, units), samples)
                columns = self.whitened.matrix @ columns
                gains, _ = self._gains(node, columns)
                best = int(np.argmax(gains))
                rest = parts[:at] + parts[at + 1 :]
                price = _CONSTANT * len(part.constants) + PART
                yield float(gains[best]) - price, *changed(node, [*rest, (more, units[:, best])])

    def _gains(self, node: Fit, columns: Array, limits: Array | None = None) -> tuple[Array, Array]:
        """Return each column's decrease of chi-square and coefficient in a fit with all constants of a law.

        Args:
            node: The fit of the law.
            columns: Whitened changes of the ends of the legs.
            limits: Smallest and largest coefficient of each column, or of all; None for any.
        """
        rows = len(columns)
        basis = np.linalg.qr(node.slope[:rows])[0]
        left = node.misfits[:rows] - basis @ (basis.T @ node.misfits[:rows])
        *shared, along = np.vstack([basis.T, left]) @ columns
        whole = np.einsum("ij,ij->j", columns, columns)
        length = np.maximum(whole - (np.array(shared) ** 2).sum(axis=0), 1e-6 * whole + _TINY)
        sizes = along / length
        if limits is not None:
            sizes = np.clip(sizes, limits[..., 0], limits[..., 1])
        return 2 * sizes * along - sizes**2 * length, sizes

    def _columns(self, node: Fit) -> _Library:
        """Return the cached library. The first call computes it, with the masses of `node`."""
        if "library" in self._kept:
            return self._kept["library"]
        constants = named(node.structure, node.unit[:, None])
        terms, units, columns = list(self._entries()), list[Array](), list[Array]()
        counts = list[int]()
        for term in terms:
            samples = self._samples(len(term.ranges(0)) - _linear(term.kind))
            unit = np.array([_sampled(bounds, samples, self.rng) for bounds in term.ranges(0).values()])
            values = _values(term, unit)
            if _linear(term.kind):
                values[next(iter(values))] = np.ones(samples)
            columns.append(self._column(term, constants, values, samples))
            units.append(unit)
            counts.append(samples)
        found = _Library(
            terms,
            units,
            np.repeat(np.arange(len(terms)), counts),
            np.concatenate([np.arange(count) for count in counts]),
            self.whitened.matrix @ np.hstack(columns),
        )
        return self._kept.setdefault("library", found)

    def _column(self, term: Term, masses: Mapping[str, Any], values: dict[str, Any], samples: int) -> Array:
        """Return how much a term changes the end of each leg, for sampled values of its constants."""
        own = {name: np.broadcast_to(masses[name], samples) for name in ("m", "m2") if name in masses}
        with np.errstate(all="ignore"):
            return np.nan_to_num(self.whitened.legs.columns(term, own | values, samples))

    def _entries(self) -> Iterator[Term]:
        for form in self.forms:
            yield Term(form.name)
            for part in self.factors:
                if form.group in part.fits:
                    yield Term(form.name, (part.name,))

    @staticmethod
    def _samples(constants: int) -> int:
        return max(1, min(_SAMPLES[0] * constants, _SAMPLES[1]))


def _by_score(offer: Offer) -> float:
    return -offer[0]


def changed(node: Fit, parts: Sequence[tuple[Term, Array]]) -> tuple[Structure, Array]:
    """Return a structure with the masses of a fit and these terms, and its point of the unit cube."""
    parts = sorted(parts, key=lambda part: part[0])
    structure = Structure(node.structure.apparatus, tuple(term for term, _ in parts), node.structure.radius)
    return structure, np.concatenate([node.masses, *(unit for _, unit in parts)])


def _values(term: Term, units: Array) -> dict[str, Any]:
    """Convert points of the unit cube to the constants of a term."""
    return {name: to_value(bounds, unit) for (name, bounds), unit in zip(term.ranges(0).items(), units, strict=True)}


def plainer(term: Term, unit: Array, gone: int) -> tuple[Term, Array]:
    """Return a term without one of its modulations, and its constants.

    Args:
        term: The term.
        unit: Its constants, as a point of the unit cube.
        gone: Index of the modulation to remove.
    """
    names = list(term.ranges(0))
    kept = [at for at, name in enumerate(names) if not name.endswith(f"0m{gone}")]
    return Term(term.form, (*term.modulations[:gone], *term.modulations[gone + 1 :])), unit[kept]


def _with_modulation(term: Term, unit: Array, name: str, fresh: Array) -> Array:
    """The constants of a term with an additional modulation; a column for each sample of its constants."""
    blocks = [np.repeat(unit[: len(term.kind.constants), None], fresh.shape[1], axis=1)]
    at = len(term.kind.constants)
    own: list[tuple[str, Array]] = [(name, fresh)]
    for other, part in zip(term.modulations, term.factors, strict=True):
        size = len(part.constants)
        own.append((other, np.repeat(unit[at : at + size, None], fresh.shape[1], axis=1)))
        at += size
    return np.vstack([*blocks, *(block for _, block in sorted(own, key=lambda pair: pair[0]))])


def _linear(form: Form) -> bool:
    """Return whether the force is proportional to the first constant."""
    return not next(iter(form.constants)).startswith("q")


def _size(form: Form) -> Range:
    return next(iter(form.constants.values()))


def _limits(form: Form) -> tuple[float, float]:
    """Smallest and largest magnitude of a term."""
    if not _linear(form):
        return 1.0, 1.0
    bounds = _size(form)
    return (-bounds.high if bounds.scale == "sign" else bounds.low), bounds.high


def _sampled(bounds: Range, count: int, rng: np.random.Generator) -> Array:
    """Return points of the search box that cover the range from which the constant is sampled."""
    share, sign = rng.random(count), np.where(rng.random(count) < 0.5, -1.0, 1.0)
    low, high = bounds.low, bounds.high
    match bounds.scale:
        case "log":
            value = low * (high / low) ** share
        case "sign":
            value = sign * low * (high / low) ** share
        case "ratio":
            value = np.where(sign > 0, low + (RATIO[0] - low) * share, RATIO[1] + (high - RATIO[1]) * share)
        case "disc":
            value = sign * high * (DISC + (1 - DISC) * share)
        case _:
            value = low + (high - low) * share
    return np.asarray(to_unit(bounds, value))
