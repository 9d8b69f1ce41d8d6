"""Fixtures for tests of certificates: laboratories in memory, a builder of faulty scenes, episodes of a template."""

from pathlib import Path

import anyio
import pytest

from evaluator.certify.subject import Subject
from evaluator.certify.verify import MemoryConnector, play_reference
from evaluator.records.episode import Episode
from scenes import Category
from tests.builders.author import TEMPLATE_SEEDS, Author


@pytest.fixture
def author(tmp_path: Path) -> Author:
    """A builder of scenes with deliberate faults, in a new folder."""
    return Author(tmp_path)


@pytest.fixture(scope="session")
def episodes(tmp_path_factory: pytest.TempPathFactory) -> list[Episode]:
    """The reference agent's episodes in a scene made from the template of Hard scenes."""
    files = Author(tmp_path_factory.mktemp("scenes")).write(Category.HARD_SINGLE)
    subject, laboratory = Subject.open(files), MemoryConnector(files.folder.parent)

    async def play() -> list[Episode]:
        return [await play_reference(subject, seed, laboratory) for seed in range(TEMPLATE_SEEDS)]

    return anyio.run(play)


@pytest.fixture
def laboratory() -> type[MemoryConnector]:
    """The class of a laboratory that serves a folder of packs in memory."""
    return MemoryConnector


@pytest.fixture
def memory() -> MemoryConnector:
    """A laboratory that serves the suite in memory."""
    return MemoryConnector()
