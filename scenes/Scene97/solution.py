"""Scene 97: shift the anchor until the block rests between slack and stop, twice; solve for length and stiffness."""

from scenes.protocol import answer, call

BLOCK_SPRING = 200.0
REST_S = 3.0
NEAR, FAR = 0.3, 3.2
SLACK_M, STOP_M = 1e-6, 0.0198


def _put(anchor, place):
    """Shift the anchor to a place, and let the block come to rest."""
    return [
        call("move_object", object_id=anchor, x=place, y=0, z=1),
        call("step", duration=REST_S),
        call("get_position", object_id="object_1"),
    ]


def solve(task):
    """Halve the range until the block hangs between slack and stop; then once more at another place there."""
    found = yield [call("find_objects")]
    anchor = found[0]["revealed"][0]["object_id"]
    slack, stopped = NEAR, FAR
    while True:
        place = (slack + stopped) / 2
        readings = yield _put(anchor, place)
        x = readings[-1]["position"][0]
        if x < SLACK_M:
            slack = place
        elif x > STOP_M:
            stopped = place
        else:
            break
    other = (slack + place) / 2 if x > STOP_M / 2 else (place + stopped) / 2
    while True:
        readings = yield _put(anchor, other)
        again = readings[-1]["position"][0]
        if SLACK_M < again < STOP_M:
            break
        other = (other + place) / 2
    # K x = k (D - x - L) at both places.
    stiffness = BLOCK_SPRING * (again - x) / ((other - again) - (place - x))
    yield [answer([place - x - BLOCK_SPRING * x / stiffness, stiffness])]


def theory(knobs):
    """The length and the stiffness that were drawn."""
    return [knobs["length"], knobs["k"]]


def measure(engine, knobs):
    """Two rests of the engine's block, at stretches that the true values choose."""
    start, rests = engine.save(), []
    for x in (0.006, 0.014):
        place = knobs["length"] + x + BLOCK_SPRING * x / knobs["k"]
        engine.restore(start)
        engine.place("object_2", [place, 0.0, 1.0], {})
        engine.step(engine.whole_steps(2 * REST_S))
        rests.append((place, float(engine.pose("object_1").position[0])))
    (near, less), (far, more) = rests
    stiffness = BLOCK_SPRING * (more - less) / ((far - more) - (near - less))
    return [near - less - BLOCK_SPRING * less / stiffness, stiffness]
