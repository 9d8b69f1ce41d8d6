"""Scene 38: map the pull of the cords with a puck that drifts, fit three cords, predict the balance at 70 N."""

from math import atan2, cos, hypot, inf, log, pi, sin

import numpy as np
from scipy.optimize import least_squares, minimize

from scenes.family import member
from scenes.protocol import answer, call

PUCK = "object_1"
FAR_N = ((0.0, -70.0), (70.0, 0.0))
LIMIT_N, EDGE_M = 12.0, 0.185
FIRST_N, FIRST_S, FIRST_M_S = 0.2, 0.2, 0.02
PAIRS = 7
LOOKS = 3
LONGEST_S = 2.0
LAB_S = 26.0
"""Lab time of which each push takes at most the half of what is left."""
STEP_S = 0.005
"""The velocity that is read is that of a time step which began so much earlier."""
ROUNDING = 0.0002 / 12**0.5
"""Standard deviation of a reading, m and m/s."""
ALL_ROUND = (0.0, pi, pi / 2, 3 * pi / 2)
KINKS_M = (0.035, 0.05)
BEAM = 3
"""Fits that are carried on to more kinks."""
PENALTY = 12.0
"""Score of each parameter of a kink."""
VALUES = {"E": 0, "W": 1, "S": 2}
"""Kind of a cord → parameters of its kink: elastic throughout, lifts a weight, gets stiffer."""
CORD = ((-inf, inf), (0.4, 1.0), (-3.0, 9.0), (0.0, 0.05))
"""Ranges of the bearing and distance of a peg, and of the logarithm of the stiffness and the slack of its cord."""
KINK = ((0.03, 0.06), (log(2.5), log(4.0)))
"""Ranges of the stretch at a kink, and of the logarithm of how many times stiffer the cord gets."""


def _pull(places, cords):
    """Sum of the pulls at places (n, 2); a cord is x, y, k, length, kink (stretch), stiffness beyond over k."""
    total = np.zeros_like(places)
    for x, y, k, length, kink, beyond in cords:
        away = np.array([x, y]) - places
        distance = np.hypot(away[:, 0], away[:, 1]) + 1e-12
        stretch = np.maximum(distance - length, 0.0)
        tension = k * stretch + k * (beyond - 1.0) * np.maximum(stretch - kink, 0.0)
        total += (tension / distance)[:, None] * away
    return total


def _rest(cords, force):
    """Where force and pulls balance: the lowest place of a convex energy."""
    push = np.array(force)

    def energy(place):
        total = -push @ place
        for x, y, k, length, kink, beyond in cords:
            stretch = max(hypot(x - place[0], y - place[1]) - length, 0.0)
            total += k * stretch**2 / 2 + k * (beyond - 1.0) * max(stretch - kink, 0.0) ** 2 / 2
        return total

    def slope(place):
        return -push - _pull(place[None, :], cords)[0]

    start = push / sum(k for _, _, k, _, _, _ in cords)
    return minimize(energy, start, jac=slope, method="BFGS", options={"gtol": 1e-7}).x


def _answers(cords):
    return [float(np.hypot(*_rest(cords, force))) for force in FAR_N]


def _field(exchanges):
    """Pushes, places where the step began, and velocities of all pairs of readings inside the edge, each (n, 2)."""
    push, place, rows = (0.0, 0.0), None, []
    for asked, reading in exchanges:
        if asked.tool == "apply_force" and "error" not in reading:
            push = asked.arguments["force_vector"][:2]
        elif asked.tool == "get_position":
            place = reading["position"][:2]
        elif asked.tool == "get_velocity":
            rows.append((*push, *place, *reading["velocity"][:2]))
    table = np.array(rows)
    table = table[np.hypot(table[:, 2], table[:, 3]) < EDGE_M + 0.01]
    velocity = table[:, 4:]
    return table[:, :2], table[:, 2:4] - STEP_S * velocity, velocity


def _cords(values, kinds):
    """The cords of parameters: log of the oil; three times those of CORD; then kinks, with stiffness ratios."""
    cords, extra = [], 13
    for number, kind in enumerate(kinds):
        bearing, far, log_k, slack = values[1 + 4 * number : 5 + 4 * number]
        kink, beyond = 1.0, 1.0
        if kind != "E":
            kink, beyond = values[extra], 0.0
            extra += 1
        if kind == "S":
            beyond = np.exp(values[extra])
            extra += 1
        cords.append((far * cos(bearing), far * sin(bearing), np.exp(log_k), far + slack, kink, beyond))
    return cords


def _ranges(kinds):
    """Range of each parameter."""
    return [(-9.0, 9.0), *CORD * 3, *(edges for kind in kinds for edges in KINK[: VALUES[kind]])]


def _misfits(field, kinds, error):
    """Parameters → misfits of the velocities, in their errors (n, 2)."""
    push, place, velocity = field

    def misfits(values):
        drift = (push + _pull(place, _cords(values, kinds))) * np.exp(-values[0])
        return ((drift - velocity) / error).ravel()

    return misfits


def _error(field, fitted):
    """Errors of the velocities, with what the errors of the places add."""
    _, kinds, values = fitted
    cords = _cords(values, kinds)
    slopes = [
        (_pull(field[1] + shift, cords) - _pull(field[1] - shift, cords)) * np.exp(-values[0]) / 2e-3
        for shift in 1e-3 * np.eye(2)
    ]
    return ROUNDING * np.sqrt(1 + slopes[0] ** 2 + slopes[1] ** 2)


def _fitted(field, kinds, start, error):
    """Cords of these kinds fitted to the field from a start: a score, which is low for few and small misfits."""
    edges = np.array(_ranges(kinds)).T
    start = np.clip(start, edges[0] + 1e-6, edges[1] - 1e-6)
    found = least_squares(_misfits(field, kinds, error), start, bounds=edges, x_scale="jac", max_nfev=60)
    return 2 * found.cost + PENALTY * (len(start) - 13), kinds, found.x


def _plain(field):
    """The best fit by three cords without kinks, from starts all round."""
    push, place, velocity = field
    (oil,), *_ = np.linalg.lstsq(velocity[:2].reshape(-1, 1), push[:2].ravel(), rcond=None)
    radius = np.hypot(place[:, 0], place[:, 1])
    pull = np.hypot(*(oil * velocity - push).T)
    scale = float(np.median(pull[radius > 0.04] / (radius[radius > 0.04] - 0.03)))
    fits = []
    for turn in np.arange(0, 2 * pi / 3, pi / 9):
        start = [np.log(oil)]
        for bearing in (turn, turn + 2 * pi / 3, turn + 4 * pi / 3):
            start += [bearing, 0.7, np.log(scale), 0.03]
        fits.append(_fitted(field, "EEE", np.array(start), 2 * ROUNDING))
    return min(fits, key=lambda fit: fit[0])


def _away(fitted):
    """The bearings along the cords, away from their pegs."""
    _, kinds, values = fitted
    return [atan2(-cord[1], -cord[0]) for cord in _cords(values, kinds)]


def _with_kink(field, fitted, number, kind, error):
    """The best fit when one more cord has a kink."""
    _, kinds, values = fitted
    before = 13 + sum(VALUES[earlier] for earlier in kinds[:number])
    more = kinds[:number] + kind + kinds[number + 1 :]
    starts = [np.insert(values, before, [kink, 0.9] if kind == "S" else [kink]) for kink in KINKS_M]
    if kind == "S":  # the stiffness found so far may be that beyond the kink
        late = starts[0].copy()
        late[3 + 4 * number : 5 + 4 * number] -= (0.9, 0.03)
        starts.append(late)
    return min((_fitted(field, more, start, error) for start in starts), key=lambda fit: fit[0])


def _without_kink(field, fitted, number, error):
    """The fit when a cord has its kink no longer."""
    _, kinds, values = fitted
    before = 13 + sum(VALUES[earlier] for earlier in kinds[:number])
    less = np.delete(values, range(before, before + VALUES[kinds[number]]))
    return _fitted(field, kinds[:number] + "E" + kinds[number + 1 :], less, error)


def _structures(field):
    """The best fit of each structure: kinks are added one by one to the best fits with fewer, and taken away again."""
    level, best = [_plain(field)], {}
    error = _error(field, level[0])
    for _ in range(3):
        level = [
            _with_kink(field, fitted, number, kind, error)
            for fitted in level
            for number in range(3)
            if fitted[1][number] == "E"
            for kind in "SW"
            if _possible(fitted[1][:number] + kind + fitted[1][number + 1 :])
        ]
        level.sort(key=lambda fit: fit[0])
        for fitted in level:
            best.setdefault(_label(fitted), fitted)
        level = level[:BEAM]
    for fitted in sorted(best.values(), key=lambda fit: -len(_label(fit))):
        for number in range(3):
            if fitted[1][number] != "E" and len(_label(fitted)) > 1:
                less = _without_kink(field, fitted, number, error)
                best[_label(less)] = min(best.get(_label(less), less), less, key=lambda fit: fit[0])
    return best


def _possible(kinds):
    """Whether the cords may be of these kinds."""
    return kinds.count("W") < 2 and kinds.count("S") < 3


def _label(fitted):
    return "".join(sorted(fitted[1])).replace("E", "")


def _prediction(fitted):
    _, kinds, values = fitted
    return _answers(_cords(values, kinds))


def fit(readings, structure):
    """The two distances by the model of a structure."""
    return _prediction(_structures(_field(readings))[structure])


def rivals(readings):
    """Cords of every structure, with the errors by the best fit."""
    field = _field(readings)
    found = _structures(field)
    error = _error(field, min(found.values(), key=lambda fit: fit[0]))
    weighed = {}
    for label, (_, kinds, values) in found.items():
        best = _fitted(field, kinds, values, error)[2]
        ranges = [
            (value - 1, value + 1) if edges[1] > 2 or edges[0] < -2 else edges
            for value, edges in zip(best, _ranges(kinds), strict=True)
        ]
        weighed[label] = member(
            _misfits(field, kinds, error), lambda p, kinds=kinds: _answers(_cords(p, kinds)), best, ranges
        )
    return weighed


def _look(seconds):
    return [call("step", duration=seconds), call("get_position", object_id=PUCK), call("get_velocity", object_id=PUCK)]


def _push(force):
    return call("apply_force", object_id=PUCK, force_vector=[float(force[0]), float(force[1]), 0.0])


def _way_left(place, velocity):
    """Way from a place to the edge, straight on."""
    ahead = velocity / (np.hypot(*velocity) + 1e-12)
    along = float(place @ ahead)
    return -along + np.sqrt(max(along**2 + EDGE_M**2 - float(place @ place), 0.0))


def _plan(place, pull, oil, direction, longest):
    """The hardest push, and a pause between looks, that end before the edge: under a steady push no speed grows."""
    for size in np.geomspace(LIMIT_N, 0.2, 40):
        velocity = (size * direction + pull) / oil
        pause = min(longest, _way_left(place, velocity) / np.hypot(*velocity) / LOOKS)
        if pause > 0.35:
            return size * direction, max(0.005 * int(pause / 0.005), 0.005)
    return np.zeros(2), 0.35


def solve(task):
    """Push as hard as is safe in four directions, then along each cord; fit all structures, predict by the best."""
    exchanges = []
    calls = [_push((FIRST_N, 0)), *_look(FIRST_S)]
    readings = yield calls
    exchanges += zip(calls, readings, strict=True)
    size = FIRST_N * FIRST_M_S / max(readings[-1]["velocity"][0], 5e-4)
    push = np.array([min(size, LIMIT_N), 0.0])
    calls = [_push(push), *_look(FIRST_S)]
    readings = yield calls
    exchanges += zip(calls, readings, strict=True)
    oil = push[0] / readings[-1]["velocity"][0]
    bearings = list(ALL_ROUND)
    for pair in range(PAIRS):
        if pair == len(ALL_ROUND):
            bearings += _away(_plain(_field(exchanges)))
        direction = np.array([cos(bearings[pair]), sin(bearings[pair])])
        for _ in range(2):
            place, velocity = np.array(readings[-2]["position"][:2]), np.array(readings[-1]["velocity"][:2])
            left = LAB_S - readings[-1]["sim_time"]
            longest = max(min(LONGEST_S, left / 2 / LOOKS), 0.36)
            push, pause = _plan(place, oil * velocity - push, oil, direction, longest)
            calls = [_push(push), *(_look(pause) * LOOKS)]
            readings = yield calls
            exchanges += zip(calls, readings, strict=True)
    best = _structures(_field(exchanges))
    yield [answer(_prediction(min(best.values(), key=lambda fit: fit[0])))]


def _drawn(knobs):
    cords = []
    for i in "123":
        x, y, k, length, kink, extra = (knobs[name + i] for name in ("x", "y", "k", "L", "s", "extra"))
        cords.append((x, y, k, length, kink, 1 + extra / k))
    return cords


def structure(knobs):
    """Which kinks there are."""
    return knobs["kind"]


def theory(knobs):
    """The balance of forces."""
    return _answers(_drawn(knobs))


def measure(engine, knobs):
    """The puck without the edge, pushed until it rests."""
    found = []
    for force in FAR_N:
        free = engine.changed({"body[rim].pos": (1000.0, 0.0, 0.0)})
        free.push(PUCK, force=np.array([*force, 0.0]))
        free.step(free.whole_steps(60.0))
        found.append(float(np.hypot(*free.pose(PUCK).position[:2])))
    return found


def settles(engine, knobs, off):
    """By which share the puck is off its rest in the end, the force constant; the larger of the two."""
    left = []
    for force in FAR_N:
        free = engine.changed({"body[rim].pos": (1000.0, 0.0, 0.0)})
        rest = _rest(_drawn(knobs), force)
        free.place(PUCK, np.array([*(1 + off) * rest, 0.02]), {})
        free.push(PUCK, force=np.array([*force, 0.0]))
        free.step(free.whole_steps(60.0))
        left.append(float(np.hypot(*(free.pose(PUCK).position[:2] - rest)) / np.hypot(*rest)))
    return max(left)


def naive(knobs):
    """All cords elastic throughout; or the rest at 4 N in proportion."""
    cords = _drawn(knobs)
    weak = [float(np.hypot(*_rest(cords, np.array(force) * 4 / 70))) * 70 / 4 for force in FAR_N]
    return {"elastic throughout": _answers([(*cord[:4], 1.0, 1.0) for cord in cords]), "in proportion": weak}


def stage(task):
    """Ask for 70 N, and answer with where the puck is then."""
    found = []
    for force in FAR_N:
        readings = yield [_push(force), *_look(6.0)]
        found.append(float(np.hypot(*readings[2]["position"][:2])))
    yield [answer(found)]


def batch(task):
    """Fifteen looks under pushes that grow, in directions all round."""
    calls = []
    for turn in range(15):
        size = 0.3 * (12 / 0.3) ** (turn / 14)
        bearing = 0.7 * pi * turn
        calls += [_push((size * cos(bearing), size * sin(bearing))), *_look(2.2)]
    readings = yield calls
    best = _structures(_field(list(zip(calls, readings, strict=True))))
    yield [answer(_prediction(min(best.values(), key=lambda fit: fit[0])))]
