"""Detectors of failures in the calls: unknown or confused objects, and arguments that do not fit."""

import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from itertools import islice

from evaluator.quantities.spoken import Spoken, spoken_numbers
from evaluator.quantities.units import Unit, parse_unit
from evaluator.records.episode import Episode, Grade, Verdict
from evaluator.scores.failures.findings import (
    ANSWER,
    Evidence,
    ExpectedForm,
    Failure,
    FailureMode,
    Place,
    answering_turn,
    exchanges,
    has_answered,
    objects_named,
    quote_at,
    read_before_answer,
    succeeded,
)
from scenes import AnswerKind

MASS_TOLERANCE = 0.05
"""Relative difference above which a mass in a call counts as different from the measured mass."""

MAX_EVIDENCE = 20
"""Largest number of pieces of evidence of one kind in a failure, because an agent may repeat a mistake often."""

_ID = re.compile(r"\bobject_\d+\b")
_UNKNOWN = re.compile(r"there is no object\b|\bbody (?:with name|named) '.*' not found", re.IGNORECASE)
_ID_THEN_NAME = re.compile(r"\b(object_\d+)`?\s?\(`?([A-Za-z]\w*)`?[),]")
_NAME_THEN_ID = re.compile(r"\b([A-Za-z]\w*)`?\s?\(`?(object_\d+)`?[),]")
_REFUSED_BY_OTHERS = re.compile(
    r"\bmust be a\b|unexpected keyword argument|missing \d+ required|can't multiply|could not convert"
)
"""Wordings of bad-argument errors in the authors' program. Our server starts such an error with the tool's name."""
_PLACE_READINGS = frozenset({"get_position", "get_displacement", "get_center_of_mass"})
_PREFERS_MEASURED = re.compile(
    r"\b(?:actual|true|real|verified|simulat\w+|returned|measured)\b[^.\n]{0,16}\bmass\b|"
    r"\bmass\b[^.\n]{0,16}\b(?:verified|(?:in|by|from|per) the simulat\w+)",
    re.IGNORECASE,
)
_KILOGRAM = parse_unit("kg")
_RATIOS = (
    frozenset({"get_rotational_energy", "get_angular_momentum"}),
    frozenset({"get_kinetic_energy", "get_momentum"}),
)
"""Pairs of tools in whose ratio of results the mass cancels."""
_TEXT_ARGUMENTS = frozenset({"name", "joint", "shape", "type", "answer", "reasoning", "label"})
"""Arguments whose value is text. Text in any other argument is a placeholder for a value that the agent lacked."""


def object_id_confusion(episode: Episode, grade: Grade, expected: ExpectedForm) -> Failure | None:
    """Detect an object id that the agent had not been given, confused objects, or an unmeasured object as the answer.

    The last case: the answer names an object and is strictly wrong, and the agent read at most the position of this
    object, but measured at least two others.

    Args:
        episode: The recorded episode.
        grade: Its grade.
        expected: The form of answer that was asked for. A name that several objects share is ignored.
    """
    objects = expected.objects
    unknown = [
        Evidence(
            turn=place.turn,
            exchange=place.position,
            quote=quote_at(place.exchange.text or ", ".join(objects_named(place))),
        )
        for place in exchanges(episode)
        if place.exchange.is_error and _names_an_unknown(place, episode)
    ]
    mistaken = list(islice(_mistaken(episode, objects), MAX_EVIDENCE))
    answered = list(_answered_unmeasured(episode, expected)) if grade.strict is Verdict.INCORRECT else []
    if not unknown and not mistaken and not answered:
        return None
    # An unknown object may exist but be hidden, so the explanation must not say whether it exists.
    calls = f"named an object that it did not know of in {len(unknown)} {'call' if len(unknown) == 1 else 'calls'}"
    mistakes = [calls] * bool(unknown) + ["took one object for another"] * bool(mistaken)
    mistakes += ["answered with an object that it had not measured, unlike others"] * bool(answered)
    return Failure(
        mode=FailureMode.OBJECT_ID,
        explanation=f"It {' and '.join(mistakes)}.",
        evidence=(*unknown[:MAX_EVIDENCE], *mistaken, *answered),
    )


def _answered_unmeasured(episode: Episode, expected: ExpectedForm) -> Iterator[Evidence]:
    """Yield the answer if it names an object of which only the position was read, while two others were measured."""
    asks_for_an_object = expected.kind is AnswerKind.OBJECTS or (
        expected.kind is AnswerKind.CHOICE and not expected.options
    )
    if not has_answered(episode) or not asks_for_an_object:
        return
    said = str(episode.answer).strip().lower()
    answered = said if _ID.fullmatch(said) else f"object_{said}"
    measured = {
        name
        for place in read_before_answer(episode)
        if place.tool not in _PLACE_READINGS
        for name in objects_named(place)
    }
    if answered in expected.objects and answered not in measured and len(measured & set(expected.objects)) > 1:
        yield Evidence(turn=answering_turn(episode), quote=quote_at(episode.turns[-1].reasoning))


def _names_an_unknown(place: Place, episode: Episode) -> bool:
    named = objects_named(place)
    if not named:
        return False
    if _UNKNOWN.search(place.exchange.text):
        return True
    # The error of a call that was rejected before it ran does not reveal whether its objects exist.
    known = set(_ID.findall(episode.prompt)) | _returned_ids(episode, place)
    return not place.exchange.returned and any(_ID.fullmatch(name) and name not in known for name in named)


def _returned_ids(episode: Episode, before: Place) -> set[str]:
    """Return the object ids in the results of all earlier calls."""
    return {
        found
        for place in exchanges(episode)
        if (place.turn, place.position) < (before.turn, before.position)
        for found in _ID.findall(place.exchange.text)
    }


def _mistaken(episode: Episode, objects: Mapping[str, str]) -> Iterator[Evidence]:
    """Yield the passages in which the reasoning combines an id with the name of another object."""
    counts = Counter(name.lower() for name in objects.values())
    ids = {name.lower(): object_id for object_id, name in objects.items() if counts[name.lower()] == 1}
    for number, turn in enumerate(episode.turns):
        pairs = [(match.start(), match[1], match[2]) for match in _ID_THEN_NAME.finditer(turn.reasoning)]
        pairs += [(match.start(), match[2], match[1]) for match in _NAME_THEN_ID.finditer(turn.reasoning)]
        yield from (
            Evidence(turn=number, quote=quote_at(turn.reasoning, start))
            for start, written, name in sorted(pairs)
            if ids.get(name.lower(), written) != written
        )


def wrong_parameter(episode: Episode, grade: Grade) -> Failure | None:
    """Detect arguments that do not fit a tool's schema, text in place of a value, or a wrong mass.

    A mass is wrong if it differs by more than `MASS_TOLERANCE` from what `get_parameters` returned for the same object
    at any time, and does not cancel in a ratio; tools do not check a given mass. A strictly wrong answer that uses a
    measured mass where the task states a different one is detected too.
    """
    masses = _measured_masses(episode)
    with_unit_mass = [place for place in exchanges(episode) if _number(place.arguments.get("mass")) == 1]
    evidence: list[Evidence] = []
    for place in exchanges(episode):
        if place.tool == ANSWER:
            continue
        mass = _number(place.arguments.get("mass"))
        measured = next((masses[name] for name in objects_named(place) if name in masses), None)
        if _does_not_fit(place) or _has_placeholder(place):
            evidence.append(Evidence(turn=place.turn, exchange=place.position, quote=quote_at(place.exchange.text)))
        elif (
            measured is not None
            and mass is not None
            and abs(mass - measured) > MASS_TOLERANCE * measured
            and not _cancels(place, mass, with_unit_mass, masses)
        ):
            evidence.append(
                Evidence(
                    turn=place.turn,
                    exchange=place.position,
                    quote=f"mass={mass:g}",
                    numbers={"given_kg": mass, "measured_kg": measured},
                )
            )
    adopted = list(_adopted_mass(episode, masses)) if grade.strict is Verdict.INCORRECT else []
    if not evidence and adopted:
        return Failure(
            mode=FailureMode.WRONG_PARAMETER,
            explanation="It took a measured mass where the task states another one.",
            evidence=tuple(adopted),
        )
    if not evidence:
        return None
    calls = "a call" if len(evidence) == 1 else f"{len(evidence)} calls"
    return Failure(
        mode=FailureMode.WRONG_PARAMETER,
        explanation=f"It made {calls} with arguments that do not fit the tool or the object.",
        evidence=(*evidence[:MAX_EVIDENCE], *adopted),
    )


def _cancels(place: Place, mass: float, with_unit_mass: Sequence[Place], masses: Mapping[str, float]) -> bool:
    """Whether a mass of 1 kg cancels in the ratio of two results.

    The two results are the energy and momentum of one object, or one tool's results for two objects of equal mass.
    """
    name = _the_object(place)
    pair = next((tools for tools in _RATIOS if place.tool in tools), frozenset({place.tool}))
    return mass == 1 and any(
        other.tool in pair - {place.tool}
        if _the_object(other) == name
        else other.tool == place.tool and _is_near(masses.get(name, 0.0), masses.get(_the_object(other), -1.0))
        for other in with_unit_mass
    )


def _the_object(place: Place) -> str:
    return next(iter(objects_named(place)), "")


def _adopted_mass(episode: Episode, measured: Mapping[str, float]) -> Iterator[Evidence]:
    """Yield the passage in which the answering turn prefers a measured mass to the mass in the task."""
    if not has_answered(episode) or not measured:
        return
    stated = [float(number.value * number.si_factor) for number in _masses_in(episode.prompt)]
    other = [mass for mass in measured.values() if not any(_is_near(mass, given) for given in stated)]
    turn = answering_turn(episode)
    text = episode.turns[turn].reasoning
    for number in _masses_in(text) if stated else ():
        value = float(number.value * number.si_factor)
        near = [mass for mass in other if abs(mass - value) <= float(number.half_unit * number.si_factor)]
        if near and _PREFERS_MEASURED.search(text[max(0, number.start - 100) : number.end + 100]):
            numbers = {"stated_kg": stated[0], "measured_kg": near[0]}
            yield Evidence(turn=turn, quote=quote_at(text, number.start), numbers=numbers)
            return


def _masses_in(text: str) -> Iterator[Spoken]:
    return (number for number in spoken_numbers(text) if number.unit is not None and _is_mass(number.unit))


def _is_mass(unit: Unit) -> bool:
    return _KILOGRAM is not None and unit.dimensions == _KILOGRAM.dimensions and not unit.angle


def _is_near(mass: float, other: float) -> bool:
    return abs(mass - other) <= MASS_TOLERANCE * max(abs(mass), abs(other))


def _does_not_fit(place: Place) -> bool:
    """Whether the tool's schema rejected a call, or the server refused one of its arguments."""
    if not place.exchange.is_error:
        return False
    said = place.exchange.text
    return not place.exchange.returned or said.startswith(f"{place.tool}: ") or bool(_REFUSED_BY_OTHERS.search(said))


def _has_placeholder(place: Place) -> bool:
    """Whether an argument is text in place of a number, such as `MASS_FROM_PREVIOUS_RESULT`."""
    return any(
        isinstance(value, str) and not value.strip().lstrip("+-").replace(".", "", 1).isdecimal()
        for name, value in place.arguments.items()
        if name not in _TEXT_ARGUMENTS and not name.endswith("_id")
    )


def _measured_masses(episode: Episode) -> dict[str, float]:
    """Object id → mass that `get_parameters` last returned for it [kg]."""
    masses: dict[str, float] = {}
    for place in exchanges(episode):
        if place.tool == "get_parameters" and succeeded(place):
            mass = _number((place.exchange.content or {}).get("mass"))
            if mass is not None and mass > 0:
                masses.update(dict.fromkeys(objects_named(place), mass))
    return masses


def _number(value: object) -> float | None:
    return float(value) if isinstance(value, int | float) and not isinstance(value, bool) else None
