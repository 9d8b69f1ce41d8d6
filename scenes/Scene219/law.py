"""Scene 219: which law the reference infers; see `scenes.reference_laws`."""


def inferred(solution, readings):
    """The law that fits best, with a mass near its first estimate."""
    return solution.FLOOR._near(readings).inferred(readings)
