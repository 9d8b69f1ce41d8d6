"""Detectors that look at the calls: objects that do not exist or are mistaken for others, arguments that do not fit."""

import re
from collections import Counter
from collections.abc import Iterator, Mapping
from itertools import islice

from evaluator.failures.course import ANSWER, Place, exchanges, objects_named, succeeded
from evaluator.failures.findings import Evidence, Failure, FailureMode, quote_at
from evaluator.records import Episode

MASS_TOLERANCE = 0.05
"""Relative difference above which a mass in a call is another than the one measured."""

MAX_EVIDENCE = 20
"""Places of one kind that a finding shows; an agent may go on for ever."""

_ID = re.compile(r"\bobject_\d+\b")
_UNKNOWN = re.compile(r"there is no object\b|\bbody (?:with name|named) '.*' not found", re.IGNORECASE)
_ID_THEN_NAME = re.compile(r"\b(object_\d+)`?\s?\(`?([A-Za-z]\w*)`?[),]")
_NAME_THEN_ID = re.compile(r"\b([A-Za-z]\w*)`?\s?\(`?(object_\d+)`?[),]")
_REFUSED_BY_OTHERS = re.compile(
    r"\bmust be a\b|unexpected keyword argument|missing \d+ required|can't multiply|could not convert"
)
"""How the authors' program words a bad argument; our laboratory begins such a refusal with the name of the tool."""
_WORDED = frozenset({"name", "joint", "shape", "type", "answer", "reasoning", "label"})
"""Arguments that are texts; a text anywhere else stands for a value that the agent did not have."""


def object_id_confusion(episode: Episode, objects: Mapping[str, str]) -> Failure | None:
    """Named an object of which it had not been told, or one object by the number of another.

    Args:
        episode: As recorded.
        objects: Ids of the scene's objects and their public names; names that several objects share say nothing.
    """
    unknown = [
        Evidence(
            turn=one.turn, exchange=one.position, quote=quote_at(one.exchange.text or ", ".join(objects_named(one)))
        )
        for one in exchanges(episode)
        if one.exchange.is_error and _names_an_unknown(one, episode)
    ]
    mistaken = list(islice(_mistaken(episode, objects), MAX_EVIDENCE))
    if not unknown and not mistaken:
        return None
    # What is unknown may exist and be hidden: no finding tells.
    calls = f"named an object that it did not know of in {len(unknown)} {'call' if len(unknown) == 1 else 'calls'}"
    told = [calls] * bool(unknown) + ["took one object for another"] * bool(mistaken)
    return Failure(
        mode=FailureMode.OBJECT_ID,
        explanation=f"It {' and '.join(told)}.",
        evidence=(*unknown[:MAX_EVIDENCE], *mistaken),
    )


def _names_an_unknown(place: Place, episode: Episode) -> bool:
    named = objects_named(place)
    if not named:
        return False
    if _UNKNOWN.search(place.exchange.text):
        return True
    # A call that was rejected before it ran says nothing of its objects.
    known = set(_ID.findall(episode.prompt)) | _told(episode, place)
    return not place.exchange.returned and any(_ID.fullmatch(one) and one not in known for one in named)


def _told(episode: Episode, before: Place) -> set[str]:
    """The ids in all returns up to a place."""
    return {
        found
        for one in exchanges(episode)
        if (one.turn, one.position) < (before.turn, before.position)
        for found in _ID.findall(one.exchange.text)
    }


def _mistaken(episode: Episode, objects: Mapping[str, str]) -> Iterator[Evidence]:
    """Places of the reasoning that give an id with the name of another object."""
    counts = Counter(name.lower() for name in objects.values())
    ids = {name.lower(): one for one, name in objects.items() if counts[name.lower()] == 1}
    for number, turn in enumerate(episode.turns):
        pairs = [(at.start(), at[1], at[2]) for at in _ID_THEN_NAME.finditer(turn.reasoning)]
        pairs += [(at.start(), at[2], at[1]) for at in _NAME_THEN_ID.finditer(turn.reasoning)]
        yield from (
            Evidence(turn=number, quote=quote_at(turn.reasoning, start))
            for start, written, name in sorted(pairs)
            if ids.get(name.lower(), written) != written
        )


def wrong_parameter(episode: Episode) -> Failure | None:
    """Called a tool with arguments that do not fit it, with a text in place of a value, or with a wrong mass.

    A wrong mass differs by more than `MASS_TOLERANCE` from what `get_parameters` returned of the same object, earlier
    or later: the tools that take a mass believe it.
    """
    masses = _measured_masses(episode)
    evidence: list[Evidence] = []
    for one in exchanges(episode):
        if one.tool == ANSWER:
            continue
        mass = _number(one.arguments.get("mass"))
        measured = next((masses[name] for name in objects_named(one) if name in masses), None)
        if _does_not_fit(one) or _placeholder(one):
            evidence.append(Evidence(turn=one.turn, exchange=one.position, quote=quote_at(one.exchange.text)))
        elif measured is not None and mass is not None and abs(mass - measured) > MASS_TOLERANCE * measured:
            evidence.append(
                Evidence(
                    turn=one.turn,
                    exchange=one.position,
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
    """Tell whether a call was rejected by its schema, or refused for an argument."""
    if not place.exchange.is_error:
        return False
    said = place.exchange.text
    return not place.exchange.returned or said.startswith(f"{place.tool}: ") or bool(_REFUSED_BY_OTHERS.search(said))


def _placeholder(place: Place) -> bool:
    """Tell whether a text stands where a number belongs, such as `MASS_FROM_PREVIOUS_RESULT`."""
    return any(
        isinstance(value, str) and not value.strip().lstrip("+-").replace(".", "", 1).isdecimal()
        for name, value in place.arguments.items()
        if name not in _WORDED and not name.endswith("_id")
    )


def _measured_masses(episode: Episode) -> dict[str, float]:
    """Object → mass that `get_parameters` returned of it last [kg]."""
    found: dict[str, float] = {}
    for one in exchanges(episode):
        if one.tool == "get_parameters" and succeeded(one):
            mass = _number((one.exchange.content or {}).get("mass"))
            if mass is not None and mass > 0:
                found.update(dict.fromkeys(objects_named(one), mass))
    return found


def _number(value: object) -> float | None:
    return float(value) if isinstance(value, int | float) and not isinstance(value, bool) else None
