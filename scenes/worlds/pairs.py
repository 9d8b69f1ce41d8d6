"""Forms of accelerations for two pucks on one floor that act on each other."""

from scenes.worlds.parts import Form, Range, size

_APART = {"dx": "o_x-x", "dy": "o_y-y", "r": "sqrt(dx**2+dy**2+0.09)"}

PAIRS = (
    Form(
        "mutual power",
        "pair",
        "the pucks draw or repel each other by a power of the distance",
        {"g#": size(1.0, 3.0, "m/s² at 1 m", "sign"), "n#": Range(0.6, 2.2, "lin")},
        _APART,
        ("g#*dx/r**(n#+1)", "g#*dy/r**(n#+1)"),
        reaction=True,
    ),
    Form(
        "mutual spring",
        "pair",
        "a force between the pucks towards a distance",
        {"k#": size(0.3, 1.0, "1/s²"), "w#": Range(1.0, 2.5, "log", "m")},
        _APART,
        ("k#*(r-w#)*dx/r", "k#*(r-w#)*dy/r"),
        reaction=True,
    ),
    Form(
        "mutual drag",
        "pair",
        "drag in proportion to the velocity from one puck to the other, near each other alone",
        {"c#": size(0.5, 1.5, "1/s"), "w#": Range(1.5, 3.0, "log", "m")},
        _APART | {"g": "exp(-(r/w#)**2)"},
        ("c#*g*(o_vx-vx)", "c#*g*(o_vy-vy)"),
        reaction=True,
    ),
    Form(
        "chase",
        "pair",
        "the first puck feels the second one, which feels nothing of it",
        {"g#": size(1.0, 3.0, "m/s² at 1 m", "sign"), "n#": Range(0.6, 2.0, "lin")},
        _APART,
        ("g#*dx/r**(n#+1)", "g#*dy/r**(n#+1)"),
    ),
    Form(
        "mutual whirl",
        "pair",
        "the first puck feels a force round the second one",
        {"g#": size(0.8, 2.4, "m/s² at 1 m", "sign"), "n#": Range(0.5, 1.8, "lin")},
        _APART,
        ("-g#*dy/r**(n#+1)", "g#*dx/r**(n#+1)"),
    ),
)
