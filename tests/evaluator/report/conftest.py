"""A study to report, and a browser to open the page in."""

from collections.abc import Generator

import pytest

from evaluator.report.agent_results import Run
from tests.builders.chromium import Page, chromium, installed
from tests.builders.reports import played, run_of


@pytest.fixture(scope="session")
def study() -> Run:
    """A study with the reference, and a model that is right if scene plus budget is even; 64 episodes."""
    rows = [
        played(scene, agent, budget, right=agent == "reference" or (scene + budget) % 2 == 0)
        for scene in range(7, 23)
        for agent in ("model:x", "reference")
        for budget in (5, 20)
    ]
    return run_of(rows)


@pytest.fixture(scope="session")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Generator[Page]:
    """A tab of headless Chromium; tests that need it are skipped where none is installed."""
    program = installed()
    if program is None:
        pytest.skip("no Chromium is installed, so the page is not opened in a browser")
    with chromium(program, tmp_path_factory.mktemp("profile")) as page:
        yield page
