"""Detectors that examine the calls: unknown or confused objects, and arguments that do not fit."""

import re
from collections import Counter
from collections.abc import Iterator, Mapping
from itertools import islice

from evaluator.failures.course import ANSWER, Place, exchanges, objects_named, succeeded
from evaluator.failures.findings import Evidence, Failure, FailureMode, quote_at
from evaluator.records import Episode

MASS_TOLERANCE = 0.05
"""Relative difference above which a mass in a call counts as different from the measured mass."""

MAX_EVIDENCE = 20
"""Greatest number of pieces of evidence of one kind in a failure; an agent may repeat a mistake without limit."""

_ID = re.compile(r"\bobject_\d+\b")
_UNKNOWN = re.compile(r"there is no object\b|\bbody (?:with name|named) '.*' not found", re.IGNORECASE)
_ID_THEN_NAME = re.compile(r"\b(object_\d+)`?\s?\(`?([A-Za-z]\w*)`?[),]")
_NAME_THEN_ID = re.compile(r"\b([A-Za-z]\w*)`?\s?\(`?(object_\d+)`?[),]")
_REFUSED_BY_OTHERS = re.compile(
    r"\bmust be a\b|unexpected keyword argument|missing \d+ required|can't multiply|could not convert"
)
"""How the authors' program reports a bad argument; our laboratory starts such a refusal with the name of the tool."""
_TEXT_ARGUMENTS = frozenset({"name", "joint", "shape", "type", "answer", "reasoning", "label"})
"""Arguments whose value is a text; a text in any other argument is a placeholder for a value the agent did not have."""


def object_id_confusion(episode: Episode, objects: Mapping[str, str]) -> Failure | None:
    """Used an object id that it had not been given, or gave an object the id of another one.

    Args:
        episode: As recorded.
        objects: Object id → public name. A name that several objects share is ignored.
    """
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
    if not unknown and not mistaken:
        return None
    # An unknown object may exist and be hidden, so the explanation does not say whether it exists.
    calls = f"named an object that it did not know of in {len(unknown)} {'call' if len(unknown) == 1 else 'calls'}"
    mistakes = [calls] * bool(unknown) + ["took one object for another"] * bool(mistaken)
    return Failure(
        mode=FailureMode.OBJECT_ID,
        explanation=f"It {' and '.join(mistakes)}.",
        evidence=(*unknown[:MAX_EVIDENCE], *mistaken),
    )


def _names_an_unknown(place: Place, episode: Episode) -> bool:
    named = objects_named(place)
    if not named:
        return False
    if _UNKNOWN.search(place.exchange.text):
        return True
    # The error of a call that was rejected before it ran does not say whether its objects exist.
    known = set(_ID.findall(episode.prompt)) | _returned_ids(episode, place)
    return not place.exchange.returned and any(_ID.fullmatch(name) and name not in known for name in named)


def _returned_ids(episode: Episode, before: Place) -> set[str]:
    """The object ids in the results of all earlier calls."""
    return {
        found
        for place in exchanges(episode)
        if (place.turn, place.position) < (before.turn, before.position)
        for found in _ID.findall(place.exchange.text)
    }


def _mistaken(episode: Episode, objects: Mapping[str, str]) -> Iterator[Evidence]:
    """Yield the places where the reasoning writes an id with the name of another object."""
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


def wrong_parameter(episode: Episode) -> Failure | None:
    """Called a tool with arguments that do not fit its schema, with a text in place of a value, or with a wrong mass.

    A wrong mass differs by more than `MASS_TOLERANCE` from the mass that `get_parameters` returned for the same object,
    earlier or later. Tools that take a mass use it without checking it.
    """
    masses = _measured_masses(episode)
    evidence: list[Evidence] = []
    for place in exchanges(episode):
        if place.tool == ANSWER:
            continue
        mass = _number(place.arguments.get("mass"))
        measured = next((masses[name] for name in objects_named(place) if name in masses), None)
        if _does_not_fit(place) or _has_placeholder(place):
            evidence.append(Evidence(turn=place.turn, exchange=place.position, quote=quote_at(place.exchange.text)))
        elif measured is not None and mass is not None and abs(mass - measured) > MASS_TOLERANCE * measured:
            evidence.append(
                Evidence(
                    turn=place.turn,
                    exchange=place.position,
                    quote=f"mass={mass:g}",
                    numbers={"given_kg": mass, "measured_kg": measured},
                )
            )
    if not evidence:
        return None
    calls = "a call" if len(evidence) == 1 else f"{len(evidence)} calls"
    return Failure(
        mode=FailureMode.WRONG_PARAMETER,
        explanation=f"It made {calls} with arguments that do not fit the tool or the object.",
        evidence=tuple(evidence[:MAX_EVIDENCE]),
    )


def _does_not_fit(place: Place) -> bool:
    """Whether the tool's schema rejected a call, or the server refused one of its arguments."""
    if not place.exchange.is_error:
        return False
    said = place.exchange.text
    return not place.exchange.returned or said.startswith(f"{place.tool}: ") or bool(_REFUSED_BY_OTHERS.search(said))


def _has_placeholder(place: Place) -> bool:
    """Whether an argument has a text in place of a number, such as `MASS_FROM_PREVIOUS_RESULT`."""
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
