"""Parses the opening prompt of a world: apparatus, limits, instruments and questions.

For agents that do not have the record of the world. `scenes.worlds.tasks` writes these texts; a test compares both.
"""

import re

from scenes.errors import WorldError
from scenes.worlds.catalogue import FORMS
from scenes.worlds.experiment import LOOK_S, LOOKS, Situation
from scenes.worlds.parts import Apparatus
from scenes.worlds.questions import Question

_OPENINGS = {
    "A puck, object_1": Apparatus.PUCK,
    "Two pucks, object_1": Apparatus.PAIR,
    "A wheel, object_1": Apparatus.WHEEL,
    "A glider, object_1": Apparatus.GLIDER,
}
_NUMBER = r"-?\d+(?:\.\d+)?(?:e-?\d+)?"
_VECTOR = rf"\(({_NUMBER}(?:, {_NUMBER})*)\)|({_NUMBER})"
_WHEEL_RADIUS = 6.0
"""Placeholder for the radius in the `Situation` of a wheel, which has no floor."""
_ASKED = {
    "the x of": "dx", "the y of": "dy", "the x component of the velocity": "vx", "the y component of": "vy",
    "is the speed of": "speed", "has its angle grown": "dq", "has its x grown": "dq", "is its spin": "u",
    "is its velocity along x": "u", "How far apart": "apart", "be at least": "push", "Exactly one of these": "which",
}  # fmt: skip


def situation_of(prompt: str) -> Situation:
    """Parse the apparatus, limits and instruments of a prompt.

    Raises:
        WorldError: The prompt is not that of a world.
    """
    apparatus = next((found for text, found in _OPENINGS.items() if text in prompt), None)
    if apparatus is None or "What acts on" not in prompt:
        raise WorldError("this task is not one of a world: it names no apparatus of the grammar")
    wheel = apparatus is Apparatus.WHEEL
    radius = _WHEEL_RADIUS if wheel else _number(prompt, r"radius of (\S+) m\b|to x = (\S+) m\.")
    force = _number(prompt, rf"{'Torques' if wheel else 'Forces'}: at most (\S+) N")
    noise = _number(prompt, rf"{'Angles' if wheel else 'Positions'}\b[^\n]*standard deviation of (\S+) (?:m|rad)\b")
    seconds, calls = _number(prompt, r"Laboratory time: (\S+) s\."), _number(prompt, r"Calls: (\d+)")
    bodies = 2 if apparatus is Apparatus.PAIR else 1
    looks = int(seconds / LOOK_S + 1e-6)
    while looks * (1 + 2 * bodies) + -(-looks // LOOKS) * bodies > calls:
        looks -= 1
    return Situation(apparatus, radius, force, looks, noise, *_systematic(prompt))


def _systematic(prompt: str) -> tuple[float, float]:
    """Parse the largest bias and drift of the position instrument; zeros if the prompt states none."""
    line = re.search(r"The instrument for (?:positions|angles) also adds an error[^\n]*", prompt)
    bias, drift = (
        re.search(rf"between -\S+ and (\S+) {unit}", line[0]) if line else None
        for unit in (r"(?:m|rad) when", r"(?:m|rad)/s\b")
    )
    return (float(bias[1]) if bias else 0.0), (float(drift[1]) if drift else 0.0)


def questions_of(prompt: str) -> tuple[Question, ...]:
    """The questions of a prompt.

    Raises:
        WorldError: A question is of an unknown kind.
    """
    told = situation_of(prompt)
    found = re.search(r"\n\n(A: .*?)\n\nThe laboratory as it is decides", prompt, re.DOTALL)
    if found is None:
        raise WorldError("this task asks nothing that can be read")
    return tuple(_question(text.strip(), told) for text in re.split(r"(?:^|\n\n)[A-Z]: ", found[1]) if text.strip())


def _number(text: str, pattern: str) -> float:
    found = re.search(pattern, text)
    if found is None:
        raise WorldError(f"this task does not say what was looked for: {pattern}")
    return float(next(group for group in found.groups() if group is not None))


def _vector(text: str, before: str, size: int) -> list[float]:
    """Return the numbers that follow a phrase; zeros if the phrase is missing."""
    found = re.search(rf"(?:{before}) (?:{_VECTOR})", text)
    return [float(number) for number in (found[1] or found[2]).split(", ")] if found else [0.0] * size


def _question(text: str, told: Situation) -> Question:
    situation, _, asked = text.partition("Take the moment ")
    what = next((what for words, what in _ASKED.items() if words in text), None)
    if what is None:
        raise WorldError(f"this question is of no kind that can be read: {text}")
    if what == "which":
        return Question("which", (), (), (), 0.0, 0.0, what, options=_options(text))
    size = 2 if told.apparatus.flat else 1
    bodies = situation.split("; ")
    place, speed, push = (
        tuple(number for body in bodies for number in _vector(body, before, size))
        for before in ("put to|turned to", "with the velocity|with the spin", "with the force|with the torque")
    )
    clock = _number(situation, r"clock shows (\S+) s") if "clock shows" in situation else 0.0
    whose = re.search(r"object_(\d)", asked)
    lasting, body = _number(asked, r"^(\S+) s"), int(whose[1]) if whose else 1
    if what == "push":
        push = tuple(number for one in bodies for number in _direction(one, size))
        way = _number(asked, r"has (?:come|turned) (\S+) ")
        return Question("push", place, speed, push, clock, lasting, what, body, way)
    return Question("late" if clock else "strong", place, speed, push, clock, lasting, what, body)


def _direction(text: str, size: int) -> list[float]:
    if "in the direction of" in text:
        return [1.0 if "of positive numbers" in text else -1.0]
    return _vector(text, "in the direction", size)


def _options(text: str) -> tuple[str, ...]:
    """Return the forms of the options of a `which` question, from their sentences in the task."""
    named = {form.says: name for name, form in FORMS.items()}
    listed = text.partition("perhaps with factors. ")[2].partition(" Which one?")[0].removesuffix(".")
    says = [part.partition(": ")[2] for part in re.split(r"; (?=\d+: )", listed)]
    if not set(says) <= named.keys():
        raise WorldError(f"this question names a term that the grammar does not have: {text}")
    return tuple(named[part] for part in says)
