"""Tests of a host's default quota of episodes."""

from pathlib import Path

from physment_mcp.serving.admission import (
    EPISODE_BYTES,
    _left_in_groups,  # pyright: ignore[reportPrivateUsage] - needs a tree of control groups
    free_memory,
    usual_episodes,
)


def test_episodes_by_default_take_at_most_half_of_the_free_memory() -> None:
    for free in (4 * 10**9, 10**9, 64 * 10**6):
        assert 0.45 * free < usual_episodes(free) * EPISODE_BYTES <= 0.5 * free
    assert usual_episodes(0) == 1
    assert usual_episodes(10**12) == usual_episodes(10**13)


def test_a_system_that_tells_nothing_gets_a_thousand() -> None:
    assert usual_episodes(None) == 1000


def test_this_system_tells_how_much_memory_is_free() -> None:
    free = free_memory()
    assert free is None or 10**6 < free < 10**14


def test_the_nearest_limit_of_the_control_groups_counts(tmp_path: Path) -> None:
    own = tmp_path / "outer" / "inner"
    own.mkdir(parents=True)
    membership = tmp_path / "cgroup"
    membership.write_text("1:cpu:/x\n0::/outer/inner\n")
    for folder, most, used in ((own, "max", 5), (own.parent, "9000", 1000)):
        (folder / "memory.max").write_text(f"{most}\n")
        (folder / "memory.current").write_text(f"{used}\n")
    assert _left_in_groups(tmp_path, membership) == [8000]
    (own / "memory.max").write_text("300\n")
    (own / "memory.current").write_text("400\n")
    assert sorted(_left_in_groups(tmp_path, membership)) == [0, 8000]
    assert _left_in_groups(tmp_path, tmp_path / "none") == []
