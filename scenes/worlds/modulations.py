"""Modulations: factors that depend on position, time, velocity or history."""

from scenes.worlds.parts import PERIOD, TURN, Modulation, Range

_LENGTH = Range(2.5, 6.0, "log", "m")
_VELOCITY, _ANY = frozenset({"drag", "cross"}), frozenset({"drag", "cross", "field", "time", "body", "pair"})

PLANE_MODULATIONS = (
    Modulation(
        "shelf",
        "place",
        "more, or less, on one side of a line",
        {"k#": Range(0.3, 2.6, "ratio"), "a#": TURN, "w#": Range(-0.6, 1.4, "lin", "m")},
        "(1+(k#-1)*(0.5+0.5*tanh((x*cos(a#)+y*sin(a#)-w#)/0.25)))",
        _VELOCITY | {"field"},
    ),
    Modulation(
        "stripes",
        "place",
        "more and less in stripes",
        {"d#": Range(0.5, 0.9, "lin"), "a#": TURN, "l#": _LENGTH, "f#": TURN},
        "(1+d#*sin(2*pi*(x*cos(a#)+y*sin(a#))/l#+f#))",
        _VELOCITY | {"body"},
    ),
    Modulation(
        "outward",
        "place",
        "more, the further from the middle",
        {"l#": Range(1.5, 3.0, "log", "m")},
        "(1+(x**2+y**2)/l#**2)",
        _VELOCITY,
    ),
    Modulation(
        "inward",
        "place",
        "less, the further from the middle",
        {"l#": Range(1.0, 2.5, "log", "m")},
        "1/(1+(x**2+y**2)/l#**2)",
        _VELOCITY | {"time"},
    ),
    Modulation(
        "sectors",
        "place",
        "more and less with the direction from the middle",
        {"d#": Range(0.4, 0.8, "lin"), "f#": TURN},
        "(1+d#*(x*cos(f#)+y*sin(f#))/sqrt(x**2+y**2+0.25))",
        _VELOCITY | {"time"},
    ),
    Modulation(
        "heading",
        "motion",
        "more in one direction of motion than in the other",
        {"d#": Range(0.4, 0.8, "lin"), "a#": TURN},
        "(1+d#*(vx*cos(a#)+vy*sin(a#))/sqrt(vx**2+vy**2+1e-6))",
        _VELOCITY,
    ),
    Modulation(
        "shy",
        "motion",
        "less, the faster the body is",
        {"q#": Range(0.7, 2.5, "log", "m/s")},
        "1/(1+(vx**2+vy**2)/q#**2)",
        frozenset({"field", "time", "body", "cross", "pair"}),
    ),
)

LINE_MODULATIONS = (
    Modulation(
        "step",
        "place",
        "more, or less, beyond a place",
        {"k#": Range(0.3, 2.6, "ratio"), "w#": Range(-0.8, 0.8, "lin", "of q")},
        "(1+(k#-1)*(0.5+0.5*tanh((q-w#)/0.15)))",
        _VELOCITY | {"body"},
    ),
    Modulation(
        "teeth",
        "place",
        "more and less with the place",
        {"d#": Range(0.5, 0.9, "lin"), "l#": Range(1.5, 4.0, "log", "of q"), "f#": TURN},
        "(1+d#*sin(2*pi*q/l#+f#))",
        _VELOCITY | {"time", "body"},
    ),
    Modulation(
        "timid",
        "motion",
        "less, the faster the body is",
        {"q#": Range(0.7, 2.5, "log", "of u")},
        "1/(1+u**2/q#**2)",
        frozenset({"field", "time", "body"}),
    ),
)

COMMON_MODULATIONS = (
    Modulation("fading", "time", "less and less with time", {"T#": Range(8.0, 25.0, "log", "s")}, "1/(1+t/T#)", _ANY),
    Modulation(
        "rising",
        "time",
        "more and more with time",
        {"T#": Range(8.0, 25.0, "log", "s")},
        "(1+t/T#)",
        frozenset({"drag", "cross", "field", "pair"}),
    ),
    Modulation(
        "beat",
        "time",
        "more and less with time",
        {"d#": Range(0.5, 0.9, "lin"), "T#": PERIOD, "f#": TURN},
        "(1+d#*sin(2*pi*t/T#+f#))",
        frozenset({"drag", "cross", "field", "body", "pair"}),
    ),
    Modulation(
        "wear",
        "memory",
        "less, the further the body has gone",
        {"l#": Range(6.0, 20.0, "log", "of way")},
        "1/(1+odo/l#)",
        _ANY,
    ),
)
