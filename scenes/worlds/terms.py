"""Terms and structures: the parts of a world's laws, without values of constants and questions."""

import functools
import re
from collections.abc import Callable
from dataclasses import dataclass

from scenes.worlds.catalogue import FORMS, MODULATIONS
from scenes.worlds.parts import Apparatus, Form, Modulation, Range

START_M = 1.5
"""Distance from the middle at which the pucks of a pair start [m]."""
MASS = Range(0.8, 2.0, "log", "kg")
_CONSTANT = re.compile(r"([A-Za-z]+)(\d+)(?:m(\d+))?")
"""Pattern of a constant's name: its base name, the index of its term, and the index of its modulation."""


@dataclass(frozen=True, slots=True, order=True)
class Term:
    """A form with its modulations."""

    form: str
    modulations: tuple[str, ...] = ()

    @property
    def kind(self) -> Form:
        """Its form."""
        return FORMS[self.form]

    @property
    def factors(self) -> tuple[Modulation, ...]:
        """Its modulations."""
        return tuple(MODULATIONS[name] for name in self.modulations)

    @property
    def plain(self) -> "Term":
        """The term without its modulations."""
        return Term(self.form)

    @property
    def label(self) -> str:
        """The parts of the term in words, such as `power drag * shelf`."""
        return " * ".join((self.form, *self.modulations))

    def ranges(self, at: int) -> dict[str, Range]:
        """Return the ranges of the term's constants by name; the names contain the index of the term."""
        found = {name.replace("#", str(at)): bounds for name, bounds in self.kind.constants.items()}
        for number, part in enumerate(self.factors):
            found |= {name.replace("#", f"{at}m{number}"): bounds for name, bounds in part.constants.items()}
        return found

    def written(self, at: int) -> tuple[dict[str, str], tuple[str, ...], tuple[str, ...]]:
        """Return intermediate quantities, components of the acceleration, and factors, in local names."""
        let = {name: text.replace("#", str(at)) for name, text in self.kind.let.items()}
        force = tuple(text.replace("#", str(at)) for text in self.kind.force)
        factors = tuple(part.factor.replace("#", f"{at}m{number}") for number, part in enumerate(self.factors))
        return let, force, factors

    def hidden_at(self, at: int) -> tuple[str, ...]:
        """Return components of the acceleration of the term's hidden body, in local names; none if it has none."""
        return tuple(text.replace("#", str(at)) for text in self.kind.hidden)


@dataclass(frozen=True)
class Structure:
    """The terms that act on an apparatus.

    Attributes:
        apparatus: The bodies that can be pushed.
        terms: Sorted by the constructor, so that equal structures have equal labels.
        radius: Distance at which the soft wall of the floor, or the buffers of the rail, begin [m].
    """

    apparatus: Apparatus
    terms: tuple[Term, ...]
    radius: float = 6.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "terms", tuple(sorted(self.terms)))

    @property
    def label(self) -> str:
        """The structure in words."""
        return f"{self.apparatus}: " + "; ".join(term.label for term in self.terms)

    @functools.cached_property
    def ranges(self) -> dict[str, Range]:
        """The ranges of all constants by name, masses first."""
        found = dict.fromkeys(self.masses, MASS)
        for at, term in enumerate(self.terms):
            found |= term.ranges(at)
        return found

    @property
    def masses(self) -> tuple[str, ...]:
        """The constants that are masses, or the moment of inertia of a wheel."""
        return ("m", "m2") if self.apparatus is Apparatus.PAIR else ("m",)

    @property
    def bodies(self) -> int:
        """Number of bodies that an agent sees."""
        return 2 if self.apparatus is Apparatus.PAIR else 1

    @property
    def hidden(self) -> tuple[int, ...]:
        """Indices of the terms with a hidden body."""
        return tuple(at for at, term in enumerate(self.terms) if term.kind.hidden)

    @property
    def worn(self) -> bool:
        """Whether the law depends on the path length of the body."""
        return any("wear" in term.modulations for term in self.terms)

    @property
    def modulations(self) -> frozenset[str]:
        """Names of the modulations of all terms."""
        return frozenset(name for term in self.terms for name in term.modulations)

    @property
    def repeats(self) -> bool:
        """Whether a modulation occurs more than once. The grammar draws no such structure."""
        return len(self.modulations) < sum(len(term.modulations) for term in self.terms)

    @functools.cached_property
    def states(self) -> tuple[str, ...]:
        """Names of the state variables: first the readable ones, then those of hidden bodies and the path length."""
        names = ("x", "y", "vx", "vy") if self.apparatus.flat else ("q", "u")
        found = [f"b{body}_{name}" for body in range(1, self.bodies + 1) for name in names]
        found += [f"h{at}_{name}" for at in self.hidden for name in names]
        return (*found, *(("odo", "odo_v") if self.worn else ()))

    @property
    def start(self) -> tuple[float, ...]:
        """The initial state: all at rest at 0, except that the pucks of a pair start apart."""
        apart = (-START_M, 0.0, 0.0, 0.0, START_M, 0.0, 0.0, 0.0) if self.apparatus is Apparatus.PAIR else ()
        return (*apart, *(0.0,) * (len(self.states) - len(apart)))

    @property
    def read(self) -> int:
        """Number of readable states: positions and velocities of visible bodies."""
        return self.bodies * (4 if self.apparatus.flat else 2)

    @property
    def controls(self) -> int:
        """Number of components of the forces that an agent can apply."""
        return self.bodies * (2 if self.apparatus.flat else 1)

    @property
    def parts(self) -> tuple[tuple[int, int | None], ...]:
        """Return each part as a pair: the index of its term, and the index of its modulation or None for the form."""
        return tuple(
            (at, number) for at, term in enumerate(self.terms) for number in (None, *range(len(term.modulations)))
        )

    def acts_on(self, term: Term, body: int) -> bool:
        """Return whether a term acts on a body. Terms of pairs and with hidden bodies act on the first body only."""
        return body == 1 or term.kind.group not in {"pair", "body"}

    def without(self, at: int, modulation: int | None) -> "tuple[Structure, Callable[[str], str | None]]":
        """Return the structure without a part, and a function: constant → its new name, or None if it is removed."""
        kept = list(enumerate(self.terms))
        if modulation is None:
            kept = [(old, term) for old, term in kept if old != at]
        else:
            names = self.terms[at].modulations
            kept[at] = (at, Term(self.terms[at].form, (*names[:modulation], *names[modulation + 1 :])))
        kept.sort(key=lambda pair: pair[1])
        places = {old: new for new, (old, _) in enumerate(kept)}

        def renamed(name: str) -> str | None:
            found = _CONSTANT.fullmatch(name)
            if found is None or name == "m2":
                return name
            old, number = int(found[2]), None if found[3] is None else int(found[3])
            if old not in places or (old == at and number is not None and number == modulation):
                return None
            if old == at and number is not None and modulation is not None and number > modulation:
                number -= 1
            return f"{found[1]}{places[old]}" + ("" if number is None else f"m{number}")

        return Structure(self.apparatus, tuple(term for _, term in kept), self.radius), renamed
