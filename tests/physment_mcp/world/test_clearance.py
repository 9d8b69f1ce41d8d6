"""Tests that a refusal to place a body reveals no more than readings at the stated resolution."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from physment_mcp.errors import NotPossible
from physment_mcp.scene import load_scene
from physment_mcp.session import Session
from physment_mcp.world import Fineness, Readout, World
from physment_mcp.world.clearance import FLOOR

RED = np.array([1.0, 0, 0, 1])
BALL = '<body name="object_1" pos="{0} {1} {2}"><freejoint/><geom size="{3}"/></body>'


def model(bodies: str) -> str:
    return f'<mujoco><option timestep="0.005" gravity="0 0 0"/><worldbody>{bodies}</worldbody></mujoco>'


def labels(world: World) -> dict[str, str]:
    return {body: body for body in ("world", *world.bodies)}


FINEST = 1.5e-7
"""Resolution of a bisection [m]: a tenth of the smallest shift that a test makes."""


def largest_radius(world: World, centre: Any, low: float = 0.0, high: float = 2.0) -> float:
    """Find the largest ball that can be created at a position, by refusals, as an agent could."""
    saved = world.save()
    while high - low > FINEST:
        radius = (low + high) / 2
        try:
            world.add_ball("probe", np.array(centre), 1000.0, max(radius, 1e-3), RED, labels(world))
            low = radius
        except NotPossible:
            high = radius
        world.restore(saved)
    return low


def lifted(scene: int, height: float) -> World:
    """Return the world of a scene with object_1 at another height."""
    world = Session(load_scene(scene, 1)).world
    joint = world._model.joint("object_1_joint")
    data = world._live()
    data.qpos[joint.qposadr[0] + (2 if joint.type[0] == 0 else 0)] = height
    world._keep()
    return world


@pytest.mark.parametrize(
    ("scene", "height", "centre", "resolution"),
    [
        (7, 29.5, (0.0, 0.0, 29.9), 1e-5),
        (7, 29.5, (0.217, 0.123, 29.731), 1e-5),
        (41, -0.05, (0.0, 0.0, 3.2), 5e-4),
        (41, -0.05, (0.31, 0.027, 3.05), 5e-4),
    ],
)
def test_bisecting_the_radius_of_a_refused_ball_finds_a_place_no_finer_than_it_is_read(
    scene: int, height: float, centre: tuple[float, float, float], resolution: float
) -> None:
    def found(cells: float) -> tuple[float, float]:
        world = lifted(scene, height + cells * resolution)
        return float(world.pose("object_1").position[2]), largest_radius(world, centre)

    same = {found(cells) for cells in np.linspace(-0.45, 0.45, 7)}
    assert len(same) == 1, "places that are read as the same one are told apart"
    # The refusal still depends on the position, to the resolution.
    (read, radius), (read_above, radius_above) = found(0.0), found(60.0)
    assert read_above == pytest.approx(read + 60 * resolution, abs=1e-9)
    assert 10 * resolution - FLOOR < radius - radius_above < 60 * resolution + 2 * FLOOR + resolution


@pytest.mark.parametrize(
    "bodies",
    [
        lambda shift: f'<geom type="box" size="0.1 1 1" pos="{0.8 + shift} 0 0"/>',
        lambda shift: f'<geom type="box" size="{0.1 + shift} 1 1" pos="0.8 0 0"/>',
        lambda shift: BALL.format(0.8, 0.2, 0.1, 0.1 + shift),
        lambda shift: BALL.format(0.8 + shift, 0.2, 0.1, 0.1),
        lambda shift: f'<geom type="box" size="0.1 1 1" pos="0.8 0 0" euler="0 0 {10 + 40 * shift}"/>',
        lambda shift: (
            f'<body name="b" pos="0.8 0 0"><geom type="capsule" size="0.1" fromto="{shift} 0 0 0 1 0"/></body>'
        ),
    ],
    ids=["place of a wall", "size of a wall", "radius", "place of a ball", "tilt of a wall", "end of a rod"],
)
@pytest.mark.parametrize("centre", [(0.1234, 0.0567, 0.3), pytest.param((0.0, 0.0, 0.0), marks=pytest.mark.extended)])
def test_what_no_instrument_reads_is_found_no_finer_than_a_tenth_of_a_millimetre(
    bodies: Callable[[float], str], centre: tuple[float, float, float]
) -> None:
    """The scene has no instruments: 41 shifts over a range of 0.4 mm give at most 6 different radii."""
    middle = largest_radius(World(model(bodies(0.0))), centre)
    radii = [
        largest_radius(World(model(bodies(cells * FLOOR))), centre, middle - 20 * FLOOR, middle + 20 * FLOOR)
        for cells in np.linspace(-2, 2, 41)
    ]
    assert len(set(radii)) <= 6
    assert max(radii) - min(radii) == pytest.approx(4 * FLOOR, abs=4 * FLOOR)


def test_a_refused_move_tells_a_place_no_finer_than_it_is_read() -> None:
    """Tries positions around a ball whose distances differ by less than the resolution."""

    def refused(place: float) -> list[bool]:
        resolution = Readout({"position": Fineness(0.001)})
        mover = '<body name="object_2" pos="5 0 0"><freejoint/><geom size="0.1"/></body>'
        world = World(model(BALL.format(place, 0, 0, 0.1) + mover), readout=resolution)
        start, told = world.save(), list[bool]()
        for angle in np.linspace(0, 3, 200):
            for put in (
                lambda at: world.place("object_2", at, labels(world)),
                lambda at: world.shift("object_2", at - [5, 0, 0], labels(world)),
            ):
                try:
                    put(np.array([0.1993 * np.cos(angle), 0.1993 * np.sin(angle), 0]))
                    told.append(False)
                except NotPossible:
                    told.append(True)
                world.restore(start)
        return told

    cells = [refused(place) for place in (-0.00045, -0.0002, 0.0, 0.0003, 0.00045)]
    assert all(told == cells[0] for told in cells)
    assert 0 < sum(cells[0]) < len(cells[0])


def test_a_refused_shift_does_not_tell_where_a_body_is_between_two_readings() -> None:
    wall = '<geom type="box" pos="1 0 0" size="0.1 1 1"/>'

    def farthest(place: float) -> float:
        world = World(model(BALL.format(place, 0, 0, 0.1) + wall), readout=Readout({"position": Fineness(0.01)}))
        low, high, saved = 0.0, 0.9, world.save()
        for _ in range(50):
            shift = (low + high) / 2
            try:
                world.shift("object_1", np.array([shift, 0, 0]), labels(world))
                low = shift
            except NotPossible:
                high = shift
            world.restore(saved)
        return low

    assert len({farthest(place) for place in (-0.0045, -0.001, 0.0, 0.002, 0.0045)}) == 1


def test_a_refusal_is_as_noisy_as_a_reading() -> None:
    readout = Readout({"position": Fineness(0.001, 0.02)}, "7")
    world = World(model(BALL.format(0, 0, 0, 0.1)), readout=readout)
    centre, radii, expected = np.array([1.0, 0, 0]), list[float](), list[float]()
    for _ in range(12):
        world.step(1)
        radii.append(largest_radius(world, centre))
        expected.append(float(np.linalg.norm(centre - world.pose("object_1").position)) - 0.1 + 1e-3)
    assert radii == pytest.approx(expected, abs=FLOOR)
    assert np.std(radii) > 0.01
