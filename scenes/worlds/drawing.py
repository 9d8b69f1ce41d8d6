"""Samples structures and constants reproducibly from a random stream, and assigns structures to splits."""

import functools
import hashlib
import random
from collections import Counter
from collections.abc import Sequence
from itertools import combinations

from scenes.errors import WorldError
from scenes.worlds.catalogue import forms_of, modulations_of
from scenes.worlds.levels import Difficulty
from scenes.worlds.parts import DISC, RATIO, Apparatus, Form, Range
from scenes.worlds.terms import Structure, Term

SPLITS = (("train", 55), ("validation", 15), ("test", 15), ("held-back", 15))
"""Splits, with their share of all combinations of forms [%]."""
_ALIKE = (
    {"linear drag", "saturating drag", "swirl"}, {"friction", "power friction"}, {"turn", "weak turn"},
    {"spring", "power spring", "two wells"}, {"wake", "companion"}, {"drive", "gusts", "turning wind"},
    {"drag cup", "swinger"}, {"shear", "saddle"}, {"mutual power", "chase"},
)  # fmt: skip
"""Sets of similar forms; a world has at most one of each set."""
MOST_LINE_TERMS = 4
"""Largest number of terms of a wheel or a glider."""
_DRAWS = 10_000


def draw_structure(difficulty: Difficulty, rng: random.Random, split: str | None = None) -> Structure:
    """A random structure of a difficulty.

    Args:
        difficulty: The difficulty, with the numbers of terms, modulations and hidden bodies.
        rng: The random stream.
        split: Split to which the combination of forms must belong; None for any.

    Raises:
        WorldError: No structure has these attributes.
    """
    for _ in range(_DRAWS):
        apparatus = rng.choice(difficulty.apparatuses)
        count = difficulty.terms if apparatus.flat else min(difficulty.terms, MOST_LINE_TERMS)
        forms = sorted(rng.sample(forms_of(apparatus), count), key=lambda form: form.name)
        if _agree(apparatus, forms, difficulty) and (split is None or split_of(apparatus, forms) == split):
            own = _modulated(apparatus, forms, difficulty.modulations, rng)
            if own is not None:
                return Structure(
                    apparatus, tuple(Term(form.name, names) for form, names in zip(forms, own, strict=True))
                )
    raise WorldError(f"none of {_DRAWS} draws of parts meets these attributes, such as a modulation for each term")


def split_of(apparatus: Apparatus, forms: Sequence[Form]) -> str:
    """Return the split of a combination of forms. Modulations do not matter, so splits share no combination."""
    single = _single_terms()
    if len(forms) == 1 and (apparatus, forms[0].name) in single:
        # There are so few that a hash alone would leave a split empty.
        place = 100 * single.index((apparatus, forms[0].name)) // len(single)
    else:
        place = _hash_of(apparatus, forms) % 100
    for name, share in SPLITS:
        place -= share
        if place < 0:
            return name
    raise AssertionError


def _hash_of(apparatus: Apparatus, forms: Sequence[Form]) -> int:
    text = f"{apparatus}|" + "|".join(sorted(form.name for form in forms))
    return int.from_bytes(hashlib.sha256(text.encode()).digest()[:4], "big")


@functools.cache
def _single_terms() -> tuple[tuple[Apparatus, str], ...]:
    """Return apparatus and form of all worlds with one term, in the order of their hashes."""
    apparatuses = [one for one in Apparatus if one is not Apparatus.PAIR]  # a pair has a term between its pucks
    found = [(one, form) for one in apparatuses for form in forms_of(one) if form.group == "drag"]
    return tuple((one, form.name) for one, form in sorted(found, key=lambda pair: _hash_of(pair[0], [pair[1]])))


def compatible(apparatus: Apparatus, forms: Sequence[Form]) -> bool:
    """Return whether forms may be combined in one world: there are not too many, and no two are alike."""
    groups = [form.group for form in forms]
    names = {form.name for form in forms}
    return (
        len(names) == len(forms)
        and groups.count("drag") <= 2
        and groups.count("field") + groups.count("time") <= 3
        and groups.count("push") <= 1
        and groups.count("pair") <= (2 if apparatus is Apparatus.PAIR else 0)
        and not any(len(kind & names) > 1 for kind in _ALIKE)
    )


def _agree(apparatus: Apparatus, forms: Sequence[Form], difficulty: Difficulty) -> bool:
    """Return whether forms suffice for a world: they are compatible, and one of them is dissipative."""
    groups = [form.group for form in forms]
    return (
        compatible(apparatus, forms)
        and "drag" in groups
        and groups.count("body") <= difficulty.hidden
        and (apparatus is not Apparatus.PAIR or "pair" in groups)
    )


def _modulated(
    apparatus: Apparatus, forms: Sequence[Form], count: int, rng: random.Random
) -> list[tuple[str, ...]] | None:
    """Sample the names of `count` modulations, distributed over the forms; None if the forms allow fewer."""
    own: list[list[str]] = [[] for _ in forms]
    places = [
        (at, part.name)
        for at, form in enumerate(forms)
        for part in modulations_of(apparatus)
        if form.group in part.fits
    ]
    for at, name in rng.sample(places, len(places)):
        if sum(map(len, own)) == count:
            break
        times = sum(name in names for names in own)
        if len(own[at]) < 2 and times == 0:
            own[at].append(name)
    return [tuple(sorted(names)) for names in own] if sum(map(len, own)) == count else None


def options_with(structure: Structure, form: str, count: int, rng: random.Random) -> tuple[str, ...]:
    """Return names of forms in random order: `form`, and forms that are not similar to one of the structure.

    Args:
        structure: The terms of the law.
        form: The form of one of the terms.
        count: Number of options.
        rng: The random stream.
    """
    there = {term.form for term in structure.terms}
    there |= {name for kind in _ALIKE if kind & there for name in kind}
    own = next(one.group for one in forms_of(structure.apparatus) if one.name == form)
    others = [one for one in forms_of(structure.apparatus) if one.name not in there]
    others = rng.sample(others, len(others))
    others.sort(
        key=lambda one: one.group != own
    )  # forms of the same group first, so that the groups of the options do not reveal the true one
    near = others[: (count - 1) // 2 + 1]
    chosen = [form, *(one.name for one in [*near, *rng.sample(others[len(near) :], count - 1 - len(near))])]
    return tuple(rng.sample(chosen, count))


def draw_constants(structure: Structure, rng: random.Random, names: Sequence[str] | None = None) -> dict[str, float]:
    """Sample values of the constants of a structure, or of some of them, rounded to six digits."""
    return {name: draw_constant(structure.ranges[name], rng) for name in names or structure.ranges}


def draw_constant(bounds: Range, rng: random.Random) -> float:
    """Draw a value from a range."""
    low, high = bounds.low, bounds.high
    share, sign = rng.random(), 1 if rng.random() < 0.5 else -1
    match bounds.scale:
        case "log":
            value = low * (high / low) ** share
        case "sign":
            value = sign * low * (high / low) ** share
        case "ratio":  # far from 1
            value = low + (RATIO[0] - low) * share if sign > 0 else RATIO[1] + (high - RATIO[1]) * share
        case "disc":
            value = sign * high * (DISC + (1 - DISC) * share)
        case _:
            value = low + (high - low) * share
    return float(f"{value:.6g}")


def searched(bounds: Range) -> tuple[float, float]:
    """Return the range of a constant in fits: wider than when sampled, and logarithmic if both ends are positive."""
    match bounds.scale:
        case "log":
            return 0.8 * bounds.low, 1.25 * bounds.high
        case "sign":
            return -1.25 * bounds.high, 1.25 * bounds.high
        case "ratio":
            return 0.2, 1.2 * bounds.high
        case "disc":
            return -1.1 * bounds.high, 1.1 * bounds.high
        case "angle":
            return bounds.low, bounds.high
        case _:
            more = 0.1 * (bounds.high - bounds.low)
            return bounds.low - more if bounds.low < 0 else max(0.0, bounds.low - more), bounds.high + more


def structures_of(difficulty: Difficulty) -> dict[str, int]:
    """Return the number of structures of a difficulty, by split. Takes seconds for many terms."""
    found = dict.fromkeys((name for name, _ in SPLITS), 0)
    for apparatus in difficulty.apparatuses:
        count = difficulty.terms if apparatus.flat else min(difficulty.terms, MOST_LINE_TERMS)
        fits = [frozenset(part.fits) for part in modulations_of(apparatus)]
        for forms in combinations(forms_of(apparatus), count):
            if _agree(apparatus, forms, difficulty):
                groups = tuple(sorted(form.group for form in forms))
                found[split_of(apparatus, forms)] += _placements(groups, tuple(fits), difficulty.modulations)
    return found


@functools.lru_cache(10_000)
def _placements(groups: tuple[str, ...], fits: tuple[frozenset[str], ...], count: int) -> int:
    """Return the number of ways to assign different modulations to terms of these groups, at most two per term."""
    ways = Counter({(0,) * len(groups): 1})
    for fitting in fits:
        more = Counter[tuple[int, ...]](ways)  # case in which the modulation is not used
        for taken, number in ways.items():
            for at, group in enumerate(groups):
                if group in fitting and taken[at] < 2 and sum(taken) < count:
                    more[(*taken[:at], taken[at] + 1, *taken[at + 1 :])] += number
        ways = more
    return sum(number for taken, number in ways.items() if sum(taken) == count)
