"""Certificates 1, 4 and 10: key, constant answers, instruments in the prompt. Also checks a pack's answer form."""

import re
from collections.abc import Iterable, Iterator, Sequence
from statistics import median

from evaluator.agents.reference import best_constant
from evaluator.answers.grading import grade_steps, stated_steps
from evaluator.answers.strict import AnswerKey
from evaluator.certify.records import Check, check
from evaluator.certify.subject import Draw, Subject, gap
from evaluator.quantities.units import Unit, parse_unit
from evaluator.records.episode import Episode, Outcome
from evaluator.scores.dimensions import cost_of
from scenes import AnswerKind, AnswerSpec, Pack
from scenes.draw import step_values

HALVED_SEEDS = 3
"""Number of seeds on which the time step is halved."""
THEORY_DRAWS, ENGINE_DRAWS = 200, 30
"""Number of seeds on which constant answers are tested, with a closed-form key and with a key from an engine run."""


def check_key(subject: Subject, episodes: Sequence[Episode]) -> Check:
    """Check that theory, engine, halved time step and the reference's answers agree within shares of the tolerance.

    Args:
        subject: The scene.
        episodes: The reference agent's episodes, each at another seed.
    """
    reasons: list[str] = []
    worst_engine, worst_half, worst_answer = 0.0, 0.0, 0.0
    stored, first = subject.pack.answer, subject.truth(subject.draw(0))
    if not subject.agrees(stored, first, 0.05):
        reasons.append(f"the stored answer is {stored}, but the key at seed 0 is {first}")
    for episode in episodes:
        seed = episode.key.seed
        draw = subject.draw(seed)
        key = subject.truth(draw)
        reasons += _refusals(episode)
        if episode.outcome is not Outcome.ANSWERED:
            reasons.append(f"seed {seed}: the reference ended with {episode.outcome.value}: {episode.error or ''}")
        else:
            worst_answer = max(worst_answer, gap(episode.answer, key))
            if not subject.agrees(episode.answer, key, 0.5):
                reasons.append(f"seed {seed}: the reference answered {episode.answer}; the key is {key}")
            reasons += _wrong_steps(subject, episode, draw)
        engine = subject.measured(draw)
        if engine is None:
            continue
        worst_engine = max(worst_engine, gap(engine, key))
        if not subject.agrees(engine, key, 0.25):
            reasons.append(f"seed {seed}: theory gives {key}, the engine {engine}")
        if 0 < seed <= HALVED_SEEDS:
            halved = subject.measured(draw, 0.0025)
            assert halved is not None
            worst_half = max(worst_half, gap(halved, engine))
            if not subject.agrees(halved, engine, 0.25):
                reasons.append(f"seed {seed}: half the time step gives {halved}, the whole one {engine}")
    if subject.solution.measure is None:
        reasons.append("solution.py defines no measure, so the engine was never asked")
    return check(
        "key",
        reasons,
        key_from="theory" if subject.solution.theory else "engine",
        theory_engine_gap=worst_engine,
        answer_gap=worst_answer,
        half_step_gap=worst_half,
    )


def _wrong_steps(subject: Subject, episode: Episode, draw: Draw) -> list[str]:
    """The intermediate quantities of the scene that the answer of the reference lacks or gives wrongly."""
    values = step_values(subject.files, subject.pack, draw.knobs)
    graded = grade_steps(episode, values) or {}
    return [
        f"seed {episode.key.seed}: the reference states {stated_steps(episode).get(name)} for {name}, which is"
        f" {values[name]:.6g}"
        for name, right in graded.items()
        if not right
    ]


def _refusals(episode: Episode) -> list[str]:
    exchanges = (exchange for turn in episode.turns for exchange in turn.exchanges)
    refused = next((exchange for exchange in exchanges if exchange.is_error), None)
    if refused is None:
        return []
    return [f"seed {episode.key.seed}: the reference's {refused.call.tool} was refused: {refused.text}"]


def check_constant(subject: Subject) -> Check:
    """Check that no constant answer is correct more often than allowed."""
    count = THEORY_DRAWS if subject.solution.theory else ENGINE_DRAWS
    keys = [subject.truth(subject.draw(seed)) for seed in range(1, count + 1)]
    _, share = best_constant(keys, subject.spec)
    options = subject.spec.options
    allowed = 1 / len(options) + 0.10 if options else 0.20
    reasons = (
        [f"one constant answer is right on {share:.0%} of {count} draws; at most {allowed:.0%} may be: widen the knobs"]
        if share > allowed
        else []
    )
    return check("constant", reasons, best_constant=share, allowed=allowed, draws=count)


MOST_CALLS = 150
_NEEDED_SHARE = 0.5
"""Smallest share of the allowed calls and simulated time that the reference must use, so that they are scarce."""


def check_instrument(subject: Subject, episodes: Sequence[Episode]) -> Check:
    """Check that the prompt names limits and instruments, and that the reference uses at least half of the limits.

    Args:
        subject: The scene.
        episodes: The reference agent's episodes at seeds 0, 1, ….
    """
    reasons = list(unstated(subject.pack))
    limits = subject.pack.limits
    assert limits is not None
    costs = [cost_of(episode, limits) for episode in episodes]
    calls, times = [cost.calls for cost in costs], [cost.lab_time_s for cost in costs]
    reasons += [
        f"seed {episode.key.seed}: the reference was refused: {exchange.text}"
        for episode in episodes
        for exchange in [exchange for turn in episode.turns for exchange in turn.exchanges if exchange.is_error][:1]
    ]
    if max(calls) > MOST_CALLS:
        reasons.append(f"the reference makes {max(calls)} calls; at most {MOST_CALLS} are allowed")
    for used, allowed, what in ((calls, limits.calls, "calls"), (times, limits.lab_time, "s of laboratory time")):
        if allowed is None:
            continue
        if max(used) > allowed * (1 + 1e-9):
            reasons.append(f"the reference uses {max(used):g} {what}, more than the limit of {allowed:g}")
        if median(used) < _NEEDED_SHARE * allowed:
            reasons.append(
                f"the reference uses {median(used):g} of {allowed:g} {what} on the median seed: lower the limit"
                " until it needs half"
            )
    return check("instrument", reasons, calls=median(calls), most_calls=max(calls), lab_time_s=float(median(times)))


def unstated(pack: Pack) -> Iterator[str]:
    """Yield a sentence for each limit and each resolution that a scene with predictions must set and does not."""
    limits, instruments = pack.limits, pack.instruments
    for name in ("calls", "lab_time"):
        if getattr(limits, name, None) is None:
            yield f"limits.{name} is missing: say how far an agent may go"
    permissions = [pack.permissions_of(key) for key in pack.objects]
    angles = ("angle", any(may.angle for may in permissions)), ("spin", any(may.spin for may in permissions))
    for name in ("position", "velocity", *(name for name, shown in angles if shown)):
        if not getattr(instruments, name, 0.0):
            yield f"instruments.{name} is missing or 0: say how finely it is read"


_SENTENCE_END = re.compile(r"(?<=[.?!])\s+(?=[A-Z(])")
_UNIT = r"in (?P<unit>[A-Za-zµ°%][\wµ°%·^*/⁻¹²³]*(?: per [a-z]+)*)"
_IN_QUESTION = re.compile(rf"[,(] ?{_UNIT}")
"""Matches a unit in a question, where it is set off: `how fast is it, in m/s, after 2 s?`, not `with t in seconds`."""
_IN_INSTRUCTION = re.compile(rf"\b{_UNIT}")
"""Matches a unit anywhere in an instruction on how to answer, as in `Answer both in N.`"""
_NUMERIC = {AnswerKind.NUMBER, AnswerKind.NUMBERS}


def answer_faults(pack: Pack) -> Iterator[str]:
    """The faults of a pack's key and answer form, one sentence for each, with its remedy."""
    spec = pack.answer_spec
    if spec is None:
        return
    try:
        AnswerKey(pack.answer, spec)
    except ValueError as error:
        yield f"answer: no answer can be compared with the key: {error}"
    if spec.kind is AnswerKind.TEXT:
        yield "answer_spec.kind is text, but free words cannot be graded reliably: make it a choice with options"
    if spec.kind in {AnswerKind.CHOICE, AnswerKind.OBJECTS} and not spec.options:
        yield "answer_spec.options is empty: an agent must see what it can choose from"
    if any("," in option for option in spec.options):
        yield "answer_spec.options: the prompt lists options with commas between them, so none may have a comma"
    if spec.options and str(pack.answer) not in spec.options:
        yield f"the answer {pack.answer!r} is not among the options {list(spec.options)}"
    if spec.kind is AnswerKind.FORMULA and not spec.variables:
        yield "answer_spec.variables is empty: a formula needs the variables that it may use"
    yield from _form_of_numbers(spec)
    yield from _units(pack.metadata.task, spec)


def _form_of_numbers(spec: AnswerSpec) -> Iterator[str]:
    if spec.kind in _NUMERIC and spec.unit is None:
        yield 'answer_spec.unit is missing; write "1" for a pure number'
    if spec.kind is not AnswerKind.NUMBERS:
        return
    if not spec.labels:
        yield "answer_spec.labels is empty: an agent must see what each number is, and their order"
    if isinstance(spec.unit, str):
        yield f"answer_spec.unit is {spec.unit!r}: list one unit for each label"


def _units(task: str, spec: AnswerSpec) -> Iterator[str]:
    """Report units that cannot be read, and units of the answer that differ from those of the question."""
    written = (spec.unit,) if isinstance(spec.unit, str) else spec.unit or ()
    unread = [unit for unit in written if parse_unit(unit) is None]
    if unread:
        yield f"answer_spec.unit: {unread[0]!r} is no unit that can be read, so every answer with a unit would fail"
        return
    wanted = [unit for unit in dict.fromkeys(written) if parse_unit(unit) != parse_unit("1")]
    asked = _asked_units(task)
    if wanted and not asked:
        yield f"the task's question names no unit, but answer_spec.unit says {', '.join(wanted)}: name it there too"
    elif _read(asked) != _read(wanted):
        yield (
            f"the task's question asks for {', '.join(asked)}, but answer_spec.unit says"
            f" {', '.join(wanted) or 'nothing'}: name the same units in the same order"
        )


def _asked_units(task: str) -> list[str]:
    """Return the units that the questions and the instructions of a task name, in order of first mention."""
    named: list[str] = []
    for sentence in _SENTENCE_END.split(task):
        is_instruction = sentence.startswith(("Answer", "Give"))
        if is_instruction or sentence.endswith("?"):
            pattern = _IN_INSTRUCTION if is_instruction else _IN_QUESTION
            named += [found["unit"] for found in pattern.finditer(sentence)]
    return [unit for unit in dict.fromkeys(named) if parse_unit(unit) is not None]


def _read(units: Iterable[str]) -> list[Unit | None]:
    """Parse units and remove duplicates; `degree` and `degrees` are the same unit."""
    return list(dict.fromkeys(map(parse_unit, units)))
