"""Tests of the certificate "determined" and of the neighbours of a law: a wrong law fits few readings, but not many."""

import random
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from scenes.family import largest_excess
from scenes.worlds.acceptance import Maker
from scenes.worlds.answering import answers
from scenes.worlds.catalogue import MODULATIONS, forms_of, modulations_of
from scenes.worlds.drawing import compatible, draw_constants
from scenes.worlds.experiment import Situation, simulated
from scenes.worlds.levels import difficulty_of
from scenes.worlds.parts import Apparatus
from scenes.worlds.questions import Question
from scenes.worlds.refits import Refits
from scenes.worlds.rivals import rival_of
from scenes.worlds.terms import Structure, Term
from scenes.worlds.weak_form import named

STRUCTURE = Structure(Apparatus.WHEEL, (Term("friction"), Term("slope", ("fading",))))
CONSTANTS = draw_constants(STRUCTURE, random.Random(3))
TOLD = Situation(Apparatus.WHEEL, radius=6.0, force=5.0, looks=12, noise=0.01)
ASKED = (
    Question("late", (0.5,), (4.0,), (0.0,), 40.0, 2.5, "dq"),
    Question("strong", (0.5,), (0.0,), (9.0,), 0.0, 2.0, "u"),
)


@pytest.mark.parametrize(("looks", "noise", "found"), [(12, 0.05, True), (60, 0.001, False)])
def test_few_readings_leave_a_rival_and_many_do_not(looks: int, noise: float, found: bool) -> None:
    told = Situation(Apparatus.WHEEL, 6.0, 5.0, looks, noise)
    key = answers(STRUCTURE, CONSTANTS, ASKED, 0.02)[:, 0]
    rival = rival_of(Refits(STRUCTURE, CONSTANTS, told, simulated(STRUCTURE, CONSTANTS, told, 1)), ASKED, key)
    assert (rival is not None) == found
    if rival is not None:
        assert rival.structure != STRUCTURE
        again = Refits(STRUCTURE, CONSTANTS, told, simulated(STRUCTURE, CONSTANTS, told, 1))
        fits = again.search.tried
        same = rival_of(again, ASKED, key, rival)
        assert same is not None
        assert same.structure == rival.structure
        assert again.search.tried == fits + 1  # the given rival is tried before all others


def test_an_accepted_world_has_no_rival_in_other_readings() -> None:
    world = Maker(difficulty_of(2), random.Random(5)).world()
    refits = Refits(
        world.structure, world.constants, world.told, simulated(world.structure, world.constants, world.told, 1)
    )
    assert rival_of(refits, world.questions, np.array(world.key)) is None


Terms = tuple[Term, ...]
PARTS = modulations_of(Apparatus.WHEEL)


def with_a_modulation(terms: Terms) -> Iterator[Terms]:
    for at, term in enumerate(terms):
        for part in PARTS:
            if len(term.modulations) < 2 and part.name not in term.modulations and term.kind.group in part.fits:
                yield changed(terms, at, Term(term.form, tuple(sorted((*term.modulations, part.name)))))


def with_a_term(terms: Terms) -> Iterator[Terms]:
    for form in forms_of(Apparatus.WHEEL):
        yield (*terms, Term(form.name))
        yield from ((*terms, Term(form.name, (part.name,))) for part in PARTS if form.group in part.fits)


def without_a_modulation(terms: Terms) -> Iterator[Terms]:
    for at, term in enumerate(terms):
        for gone in range(len(term.modulations)):
            yield changed(terms, at, Term(term.form, term.modulations[:gone] + term.modulations[gone + 1 :]))


def with_another_form(terms: Terms) -> Iterator[Terms]:
    for at, term in enumerate(terms):
        for form in forms_of(Apparatus.WHEEL):
            if all(form.group in MODULATIONS[name].fits for name in term.modulations):
                yield changed(terms, at, Term(form.name, term.modulations))


def changed(terms: Terms, at: int, *new: Term) -> Terms:
    return (*terms[:at], *new, *terms[at + 1 :])


def differing_by_one_part(structure: Structure) -> set[Structure]:
    """Return the structures with one part more, less, or exchanged; a new term has at most one modulation."""
    terms, plainer = structure.terms, list(without_a_modulation(structure.terms))
    shorter = [changed(terms, at) for at in range(len(terms))]
    found = [*with_a_term(terms), *with_a_modulation(terms), *plainer, *shorter, *with_another_form(terms)]
    found += [more for less in plainer for more in with_a_modulation(less)]
    found += [more for less in shorter for more in (*with_a_term(less), *with_a_modulation(less))]
    structures = {Structure(Apparatus.WHEEL, tuple(sorted(each))) for each in found} - {structure}
    return {
        other
        for other in structures
        if not other.repeats and compatible(Apparatus.WHEEL, [term.kind for term in other.terms])
    }


@pytest.mark.parametrize(
    "terms",
    [(Term("friction"), Term("slope", ("fading",))), (Term("cogging"), Term("drag cup", ("beat", "rising")))],
    ids=["one modulation", "two modulations"],
)
def test_the_neighbours_are_all_laws_that_differ_by_one_part(terms: tuple[Term, ...]) -> None:
    structure, told = Structure(Apparatus.WHEEL, terms), replace(TOLD, looks=4)
    constants = draw_constants(structure, random.Random(3))
    refits = Refits(structure, constants, told, simulated(structure, constants, told, 1))
    assert {fit.structure for fit in refits.fit_similar()} == {structure, *differing_by_one_part(structure)}


def test_fits_that_are_worse_than_expected_are_repeated_from_other_starts(monkeypatch: pytest.MonkeyPatch) -> None:
    structure, told = Structure(Apparatus.WHEEL, (Term("power spring", ("rising",)),)), replace(TOLD, looks=12)
    constants = draw_constants(structure, random.Random(2))

    def not_excluded(starts: int) -> set[str]:
        monkeypatch.setattr("scenes.worlds.refits._STARTS", starts)
        true, *similar = Refits(structure, constants, told, simulated(structure, constants, told, 1)).fit_similar()
        return {
            fit.structure.label
            for fit in similar
            if fit.chi_square <= true.chi_square + largest_excess(len(true.unit) - len(fit.unit))
        }

    assert not_excluded(0) < not_excluded(3)


def test_constants_of_similar_laws_are_in_the_ranges_of_the_grammar() -> None:
    structure, told = Structure(Apparatus.WHEEL, (Term("ratchet"),)), replace(TOLD, looks=12)
    constants = draw_constants(structure, random.Random(2))
    true, *similar = Refits(structure, constants, told, simulated(structure, constants, told, 1)).fit_similar()
    sizes = [
        (abs(named(fit.structure, fit.unit)[name]), bounds)
        for fit in similar
        if fit.chi_square <= true.chi_square + largest_excess(1)
        for name, bounds in fit.structure.ranges.items()
        if bounds.scale in {"log", "sign"}
    ]
    assert all(0.9 * bounds.low < size < 1.1 * bounds.high for size, bounds in sizes)
    assert sum(bounds.scale == "sign" for _, bounds in sizes) > 5
