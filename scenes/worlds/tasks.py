"""Writes the task of a world. Tasks of one apparatus differ only in limits and questions."""

from collections.abc import Sequence

from scenes.worlds.catalogue import FORMS
from scenes.worlds.law_texts import WALL
from scenes.worlds.parts import Apparatus
from scenes.worlds.questions import Question
from scenes.worlds.records import WorldRecord
from scenes.worlds.terms import START_M

LETTERS = "ABC"
_OPENINGS = {
    Apparatus.PUCK: (
        "A puck, object_1, whose mass you are not told, rests at the origin of a level round floor with a radius of"
        " {radius:g} m. Beyond the rim a soft wall pushes it back to the middle with {wall:g} N for each metre"
        " beyond. You can push the puck with forces along the floor. Their limit is one of the length of the vector."
    ),
    Apparatus.PAIR: (
        "Two pucks, object_1 and object_2, whose masses you are not told, rest at (-{start:g}, 0) m and ({start:g},"
        " 0) m on a level round floor with a radius of {radius:g} m. They can pass through each other. Beyond the rim"
        " a soft wall pushes each back to the middle with {wall:g} N for each metre beyond. You can push both with"
        " forces along the floor, at the same time too. The limit is one of the length of the vector, of each puck."
    ),
    Apparatus.WHEEL: (
        "A wheel, object_1, whose moment of inertia you are not told, is at rest on a fixed vertical axle. You can"
        " turn it with torques about the axle, z."
    ),
    Apparatus.GLIDER: (
        "A glider, object_1, whose mass you are not told, is at rest in the middle of a straight rail along x, which"
        " is free from x = -{radius:g} m to x = {radius:g} m. Beyond either end a soft buffer pushes it back with"
        " {wall:g} N for each metre beyond. You can push the glider with forces along the rail."
    ),
}
_FAMILY = """\
What acts on {it} besides your {push} is in no textbook. It is a sum of a few terms. Each of them is one of:

- a drag that depends on the velocity{medium};
{plane}- a {load} that depends on the {place} alone;
- a {load} that repeats itself in time{moving};
- the {load} of a hidden thing, which is at rest at the start, moves because of {first}, and draws, repels or\
 drags {first};
{pair}- a share of your {push} that is lost or added, by the {place} or by the speed.

The size of a term may be multiplied by one or two factors, and each factor depends smoothly on one of: the {place};\
 the direction of the motion; the speed; the time that the clock shows; the way that {first} has {gone} since the\
 start. Every term is in proportion to the {mass} of what it acts on.{both} All this holds everywhere and at all\
 times:{rim} after the laboratory's time, and for {push} beyond the limit. A hidden thing cannot be seen or found by\
 any tool; readings of {it} are all that tells of it."""
_PAIRED = (
    " Terms act on both pucks by the same rule, each puck by its own place and velocity; but what a hidden thing does"
    " acts on object_1 alone."
)
_ASK = """\
Find out enough to answer three questions. Their situations need not be within your limits. Each is a fresh start:\
 hidden things are at rest where they are at the start of the experiment, and the clock shows 0{where}. What is put\
 somewhere at the start is there from the first moment, at rest. It has not been moved there: it has gone no way, and\
 hidden things have felt nothing of it before. While it is held, the clock runs and hidden things move because of it,\
 but it goes no way.

{questions}

The laboratory as it is decides. Answer with a list of three numbers: {units}."""
_WHERE = {
    Apparatus.PUCK: "; but the floor has no rim and no wall",
    Apparatus.PAIR: "; but the floor has no rim and no wall",
    Apparatus.WHEEL: "",
    Apparatus.GLIDER: "; but the rail has no ends and no buffers",
}
_IT = {
    Apparatus.PUCK: "the puck",
    Apparatus.PAIR: "a puck",
    Apparatus.WHEEL: "the wheel",
    Apparatus.GLIDER: "the glider",
}
_PLANE_NUMBERS = {
    "dx": ("By how much has the x of {it} grown?", "m", "growth of x"),
    "dy": ("By how much has the y of {it} grown?", "m", "growth of y"),
    "vx": ("What is the x component of the velocity of {it}?", "m/s", "velocity along x"),
    "vy": ("What is the y component of the velocity of {it}?", "m/s", "velocity along y"),
    "speed": ("What is the speed of {it}?", "m/s", "speed"),
}
_LINE_NUMBERS = {
    (Apparatus.WHEEL, "dq"): ("By how much has its angle grown?", "rad", "growth of the angle"),
    (Apparatus.WHEEL, "u"): ("What is its spin?", "rad/s", "spin"),
    (Apparatus.GLIDER, "dq"): ("By how much has its x grown?", "m", "growth of x"),
    (Apparatus.GLIDER, "u"): ("What is its velocity along x?", "m/s", "velocity along x"),
}


def task_of(record: WorldRecord) -> str:
    """The task of a world."""
    apparatus = record.apparatus
    opening = _OPENINGS[apparatus].format(radius=record.radius, wall=WALL, start=START_M)
    questions = [
        f"{letter}: {_asked(apparatus, question)}" for letter, question in zip(LETTERS, record.questions, strict=False)
    ]
    units = ", ".join(
        f"{letter} the number of a term" if question.options else f"{letter} in {asked_of(apparatus, question)[1]}"
        for letter, question in zip(LETTERS, record.questions, strict=False)
    )
    ask = _ASK.format(where=_WHERE[apparatus], questions="\n\n".join(questions), units=units)
    return f"{opening}\n\n{_family(apparatus)}\n\n{ask}"


def _family(apparatus: Apparatus) -> str:
    """Return sentences about the possible terms of an apparatus."""
    pair, wheel = apparatus is Apparatus.PAIR, apparatus is Apparatus.WHEEL
    return _FAMILY.format(
        it=_IT[apparatus],
        first="object_1" if pair else _IT[apparatus],
        push="torques" if wheel else "forces",
        medium=", or on that relative to a medium that turns about the middle" if apparatus.flat else "",
        plane="- a force across the velocity;\n" if apparatus.flat else "",
        moving=", or that of a centre that moves by itself in a circle" if apparatus.flat else "",
        pair="- a force between the pucks, which object_2 may not feel;\n" if pair else "",
        load="torque" if wheel else "force",
        place="angle" if wheel else "place",
        gone="turned" if wheel else "gone",
        mass="moment of inertia" if wheel else "mass",
        both=_PAIRED if pair else "",
        rim="" if wheel else " beyond the rim," if apparatus.flat else " beyond the buffers,",
    )


def asked_of(apparatus: Apparatus, question: Question) -> tuple[str, str, str]:
    """Return the sentence that asks for the number, its unit and its label."""
    wheel = apparatus is Apparatus.WHEEL
    it = _name(apparatus, question.body)
    match question.what:
        case "which":
            options = "; ".join(f"{at}: {FORMS[name].says}" for at, name in enumerate(question.options, 1))
            sentence = f"Exactly one of these is a term in this laboratory, perhaps with factors. {options}. Which one?"
            return f"{sentence} Answer with its number.", "1", "number of the term"
        case "apart":
            return "How far apart are the middles of the pucks?", "m", "distance of the pucks"
        case "push":
            size = f"{question.size:g} {'rad' if wheel else 'm'}"
            load, unit = ("torque", "N·m") if wheel else ("force", "N")
            comes = f"{'turned' if wheel else 'come'} {size} or more in that direction at that moment"
            return f"How large must the {load} be at least, so that {it} has {comes}?", unit, f"least {load}"
        case what if not apparatus.flat:
            return _LINE_NUMBERS[apparatus, what]
        case what:
            sentence, unit, label = _PLANE_NUMBERS[what]
            return sentence.format(it=it), unit, label if apparatus is Apparatus.PUCK else f"{label} of {it}"


def _name(apparatus: Apparatus, body: int) -> str:
    return f"object_{body}" if apparatus is Apparatus.PAIR else _IT[apparatus]


def _asked(apparatus: Apparatus, question: Question) -> str:
    """Return the text of a question: its situation, if it has one, and the requested number."""
    sentence = asked_of(apparatus, question)[0]
    return sentence if question.options else f"{_situation(apparatus, question)} {sentence}"


def _situation(apparatus: Apparatus, question: Question) -> str:
    """Return the text of a situation, up to the moment for which the number is requested."""
    width = 2 if apparatus.flat else 1
    bodies = range(1, len(question.place) // width + 1)
    parts = [slice(width * (body - 1), width * body) for body in bodies]
    each = [
        _release(apparatus, _name(apparatus, body), question, part) for body, part in zip(bodies, parts, strict=True)
    ]
    clock = f"{question.clock:g} s"
    when = f"held there until the clock shows {clock}, and then let go" if question.clock else "let go at once"
    later = "after that" if question.clock else "later"
    text = f"{'; '.join(text.format(when=when) for text in each)}. Take the moment {question.lasting:g} s {later}."
    return text[0].upper() + text[1:] if apparatus is not Apparatus.PAIR else text


def _release(apparatus: Apparatus, it: str, question: Question, part: slice) -> str:
    wheel = apparatus is Apparatus.WHEEL
    place, speed, push = question.place[part], question.speed[part], question.push[part]
    unit, push_unit, rate = ("rad", "N·m", "rad/s") if wheel else ("m", "N", "m/s")
    load = "torque" if wheel else "force"
    put = f"{it} is {'turned' if wheel else 'put'} to {_vector(place)} {unit} at the start and {{when}}"
    motion = f"with the {'spin' if wheel else 'velocity'} {_vector(speed)} {rate}" if any(speed) else "from rest"
    held = f", with the {load} {_vector(push)} {push_unit} held on it from then on"
    if question.what == "push":
        held = f", with a constant {load} in the direction {_direction(push)} held on it from then on"
    return f"{put} {motion}{held if any(push) else ''}"


def _direction(push: Sequence[float]) -> str:
    if len(push) > 1:
        return _vector(push)
    return "of positive numbers" if push[0] > 0 else "of negative numbers"


def _vector(numbers: Sequence[float]) -> str:
    texts = [f"{number + 0.0:g}" for number in numbers]  # -0.0 becomes 0
    return f"({', '.join(texts)})" if len(texts) > 1 else texts[0]
