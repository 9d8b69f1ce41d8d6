"""Honest clients of a host that is attacked in every way get all their results, and the host closes everything."""

import sys

import pytest
from rich.console import Console

from tests.harness.load.attacks import ATTACKS
from tests.harness.load.soak import LIMITS, Sample, Soaked, report, rise, soak

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="the state of the host is found in /proc")


def soaked(memory_mb: list[float], problems: list[str]) -> Soaked:
    return Soaked([Sample(0, memory, 10, 4, 5, 100, 3, 30) for memory in memory_mb], problems=problems)


async def test_an_attacked_host_serves_honest_clients_and_closes_everything() -> None:
    console = Console(quiet=True)
    seen = await soak(seconds=8, clients=4, every_s=0.5, idle_timeout_s=2, console=console)
    assert seen.problems == []
    assert seen.attacks
    assert sum(sample.calls for sample in seen.samples) > 0


def test_what_grows_is_told_from_what_does_not() -> None:
    assert rise([5.0] * 10) == 0
    assert rise([1.0, 2.0, 3.0]) == pytest.approx(1)
    assert rise([0, 0]) == rise([7]) == 0
    quiet, many = Console(quiet=True), 3 * len(ATTACKS)
    assert report(soaked([100.0] * many, []), quiet)
    assert not report(soaked([100.0 + number for number in range(many)], []), quiet)
    assert report(soaked([100.0, 200.0], []), quiet)  # too short to be judged
    assert not report(soaked([100.0] * many, ["an honest call failed"]), quiet)
    assert set(LIMITS) <= set(Sample.__annotations__)
