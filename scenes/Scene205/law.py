"""Scene 205: which law the reference infers; see `scenes.reference_laws`."""


def inferred(solution, readings):
    """The law that fits best."""
    return solution.LAWS.best(solution._course(readings))
