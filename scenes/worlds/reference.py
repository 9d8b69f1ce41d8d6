"""The functions in the `solution.py` of a world: reference protocol, answer key, and fits of rival laws to an episode.

A rival differs from the true law by one form or modulation (`Refits.fit_similar`). It is fitted to the readings of any
agent, however few: readings that were not made contain no information.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import cast

import numpy as np

from scenes.course_record import Channel, Course, accepted, force, position, recorded, velocity
from scenes.draw import KnobValue
from scenes.pack import Knob
from scenes.protocol import AnswerValue, Exchanges, Generated, Member, Protocol
from scenes.worlds.answering import answers
from scenes.worlds.candidates import Fit
from scenes.worlds.experiment import LOOK_S, Situation
from scenes.worlds.packs import mjcf_of
from scenes.worlds.parts import Apparatus, Range
from scenes.worlds.predictions import plausible
from scenes.worlds.protocols import informed_protocol
from scenes.worlds.questions import option_of
from scenes.worlds.records import WorldRecord
from scenes.worlds.refits import Refits
from scenes.worlds.weak_form import named

SOLUTION = '''"""World {reference}: the reference that knows the structure and not the constants."""

from scenes.worlds.reference import protocol

solve = protocol({line!r})
'''
"""The content of `solution.py`. It is part of the hash of a pack, by which runs are compared."""
_STEP_S, _FINE_S = 0.05, 0.01
"""Longest integration steps for the answers of rivals, and for the key [s]."""
_NEAREST = 8
"""Number of rivals that are reported although the readings exclude them."""
_BEYOND = 60.0
"""Excess of chi-square above which a rival is reported only if it is one of the nearest."""


def protocol(line: str) -> "WorldSolution":
    """Return the functions of a world's `solution.py` from the line of its record. Stored packs contain this name."""
    return WorldSolution(WorldRecord.model_validate_json(line))


@dataclass(frozen=True)
class WorldSolution:
    """The functions of a world's `solution.py`; `load_solution` finds them as the attributes of `solve`."""

    record: WorldRecord

    def solve(self, prompt: str) -> Protocol:
        """Push the bodies in many ways, fit the constants of the known structure, and predict the answers."""
        return informed_protocol(self.record, prompt)

    def structure(self, values: Mapping[str, KnobValue]) -> str:
        """The label of the structure."""
        del values
        return self.record.structure.label

    def theory(self, values: Mapping[str, KnobValue]) -> AnswerValue:
        """The answers for values of the constants."""
        constants = cast("Mapping[str, float]", values)
        return [
            float(number) for number in answers(self.record.structure, constants, self.record.questions, _FINE_S)[:, 0]
        ]

    @property
    def generated(self) -> Generated:
        """The constants of the law and of the instruments, with their ranges."""
        told, constants = self.record.told, self.record.constants
        knobs = {name: _knob(bounds, constants[name]) for name, bounds in self.record.structure.ranges.items()}
        bounds = np.repeat([told.bias, told.drift], told.width)[: len(told.errors)]
        errors = {name: bound for name, bound in zip(told.errors, bounds.tolist(), strict=True) if bound}
        knobs |= {name: Knob(canonical=constants[name], uniform=(-bound, bound)) for name, bound in errors.items()}

        def mjcf(values: Mapping[str, KnobValue]) -> str:
            return mjcf_of(self.record.model_copy(update={"constants": {**constants, **values}}))

        return Generated(knobs, mjcf)

    def rivals(self, exchanges: Exchanges) -> dict[str, Member]:
        """Fit the true law, and all that differ from it by one part, to an episode.

        Laws that contradict a `which` question, because none or several of its options act, are omitted.

        Returns:
            The true law and the laws of smallest chi-square, by their labels.
        """
        record, course = self.record, course_of(self.record.told, exchanges)
        refits = Refits(record.structure, record.constants, record.told, course)
        drawn, *similar = refits.fit_similar()
        asked = [question for question in record.questions if question.options]
        others = [
            fit
            for fit in sorted(similar, key=lambda fit: fit.chi_square)
            if not any(math.isnan(option_of(fit.structure, question)) for question in asked)
        ]
        farthest = drawn.chi_square + _BEYOND * max(1.0, drawn.chi_square / max(course.count, 1))
        near_enough = sum(fit.chi_square < farthest for fit in others)
        kept = [drawn, *others[: max(near_enough, _NEAREST)]]
        return {fit.structure.label: self._member(fit, course.count) for fit in kept}

    def _member(self, fit: Fit, readings: int) -> Member:
        asked = self.record.questions
        found = answers(fit.structure, named(fit.structure, fit.unit[:, None]), asked, _STEP_S)[:, 0]

        def samples(number: int) -> list[AnswerValue]:
            return [list(map(float, column)) for column in plausible(fit, asked, number).T[1:]]

        return Member(fit.chi_square, readings, len(fit.unit), list(map(float, found)), samples)


def course_of(told: Situation, exchanges: Exchanges) -> Course:
    """Extract pushes and readings from the calls of any agent; NaN for readings that were not made.

    Long steps are divided into legs of at most `LOOK_S`.
    """
    course = recorded(exchanges, *_channels(told))
    clock = [0.0, *(float(reading["sim_time"]) for asked, reading in accepted(exchanges) if asked.tool == "step")]
    if len(clock) == 1:  # without a step, nothing was read
        return Course(
            np.full(1, LOOK_S), np.zeros((1, told.width * told.bodies)), np.full((1, len(told.sigma)), np.nan)
        )
    durations = np.diff(clock)  # a step lasts a whole number of time steps
    legs = np.maximum(np.ceil(durations / LOOK_S - 1e-9), 1).astype(int)
    readings = np.full((int(legs.sum()), len(told.sigma)), np.nan)
    readings[np.cumsum(legs) - 1] = course.readings
    return Course(np.repeat(durations / legs, legs), np.repeat(course.controls, legs, axis=0), readings)


def _channels(told: Situation) -> tuple[list[Channel], list[Channel]]:
    """Return the channels of the pushes and of the readings, in the order of the state."""
    bodies = [f"object_{body}" for body in range(1, told.bodies + 1)]
    if told.apparatus is Apparatus.WHEEL:
        read = [Channel("get_position", bodies[0], "angle"), Channel("get_velocity", bodies[0], "angular_velocity")]
        return [Channel("apply_torque", bodies[0], "torque_vector", 2)], read
    pushes = [force(body, axis) for body in bodies for axis in range(told.width)]
    return pushes, [of(body, axis) for body in bodies for of in (position, velocity) for axis in range(told.width)]


def _knob(bounds: Range, value: float) -> Knob:
    """Return a knob with the range of a constant. A range of both signs is one interval."""
    low, high = bounds.low, bounds.high
    if bounds.scale == "log":
        return Knob(canonical=value, log_uniform=(low, high))
    return Knob(canonical=value, uniform=(-high if bounds.scale in {"sign", "disc"} else low, high))
