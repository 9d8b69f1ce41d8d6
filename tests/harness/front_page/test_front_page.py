"""Tests that the README shows a real episode: its transcript and the caption of its picture are regenerated."""

import re
import xml.etree.ElementTree as ET
from collections import Counter

import pytest
from PIL import Image

from evaluator.certify.records import (
    CATCH_CERTIFICATES,
    CERTIFICATES,
    FAMILY_CERTIFICATES,
    PREDICTION_CERTIFICATES,
    read_certificates,
)
from evaluator.records.episode import Episode, GradeRecord, Verdict
from evaluator.report.baselines import baseline_run
from physment_mcp.serving.server import published_tools
from scenes import Category, default_folder, list_packs, read_pack
from tests.builders.paths import ROOT
from tests.harness.front_page.episode import RAMPS, SCENE, block, caption, measurements, played, title, transcript
from tests.harness.front_page.exposure import exposure
from tests.harness.front_page.make import DESCRIPTION, PICTURES

README = ROOT / "README.md"
LARGEST_BYTES = 150_000

Played = tuple[Episode, GradeRecord]


@pytest.fixture(scope="module")
def episode(tmp_path_factory: pytest.TempPathFactory) -> Played:
    return played(tmp_path_factory.mktemp("front") / "run")


def with_episode(readme: str, episode: Played) -> str:
    """The README with the transcript of an episode, and with its caption as the text of the first picture."""
    readme = re.sub(r"```text\n.*?```", lambda _: block(transcript(*episode)), readme, count=1, flags=re.DOTALL)
    return re.sub(r'alt="[^"]*"', lambda _: f'alt="{caption(*episode)}"', readme, count=1)


def test_the_readme_shows_the_transcript_of_a_real_episode(episode: Played, update_goldens: bool) -> None:
    text = README.read_text(encoding="utf-8")
    if update_goldens:
        README.write_text(with_episode(text, episode), encoding="utf-8")
        text = README.read_text(encoding="utf-8")
    assert with_episode(text, episode) == text


def test_the_transcript_has_at_most_twenty_lines_that_fit_the_page(episode: Played) -> None:
    lines = transcript(*episode)
    assert len(lines) <= 20
    assert max(map(len, lines)) <= 100


def test_the_trials_of_the_episode_halve_the_range_until_its_answer_is_left(episode: Played) -> None:
    played, grade = episode
    tried = measurements(played)
    assert all(measured.low <= measured.ramp <= measured.high for measured in tried)
    assert grade.grade.strict is Verdict.CORRECT
    last = tried[-1]
    left = (last.low, last.ramp) if last.slides else (last.ramp + 1, last.high)
    assert left == (int(str(played.answer)),) * 2


def test_the_exposure_shows_the_ramps_and_where_the_slider_was_set_down_and_where_it_was_read(episode: Played) -> None:
    bodies = {body.get("name"): body for body in ET.fromstring(exposure(episode[0])).iter("body")}
    measured = measurements(episode[0])
    assert bodies.keys() == {f"object_{1 + ramp}" for ramp in range(1, RAMPS + 1)} | {
        f"{moment}_{number}" for number in range(1, len(measured) + 1) for moment in ("before", "after")
    }
    for number, done in enumerate(measured, start=1):
        (x, y, z), (later_x, later_y, later_z) = (place(bodies[f"{moment}_{number}"]) for moment in ("before", "after"))
        assert y == later_y == done.ramp
        assert (later_x > x + 0.05) is done.slides
        assert later_z < z


def place(body: ET.Element) -> list[float]:
    return [float(value) for value in str(body.get("pos")).split()]


def test_the_episode_is_not_taken_for_one_of_a_scene_of_the_suite(episode: Played) -> None:
    assert SCENE not in {files.scene_id for files in list_packs()}
    shown = (title(episode[0]), caption(*episode), *transcript(*episode))
    assert [text for text in shown if re.search(r"\bscene\b", text, re.IGNORECASE)] == []


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_the_picture_of_the_scene_is_of_this_episode(episode: Played, scheme: str) -> None:
    """If this fails, the scene has changed: run `python -m tests.harness.front_page.make` again."""
    with Image.open(PICTURES / f"scene-{scheme}.webp") as picture:
        assert picture.getexif()[DESCRIPTION] == caption(*episode)


def test_every_picture_is_small_and_shown_by_the_readme_or_a_guide() -> None:
    files = sorted(PICTURES.iterdir())
    pages = [README, *(ROOT / "docs" / "how-to").glob("*.md")]
    shown = {
        (page.parent / name).resolve()
        for page in pages
        for name in re.findall(r'(?:src|srcset)="([^"]+)"', page.read_text(encoding="utf-8"))
    }
    assert sorted(shown) == files
    assert [file.name for file in files if file.stat().st_size > LARGEST_BYTES] == []


def test_the_numbers_of_the_readme_are_true() -> None:
    text = " ".join(README.read_text(encoding="utf-8").split())
    certificates = read_certificates(default_folder())
    assert certificates is not None
    kinds = [{check.name for check in scene.checks} for scene in certificates.scenes]
    assert set.intersection(*kinds) == set(CERTIFICATES)
    assert set.union(*kinds) == {
        *CERTIFICATES,
        *PREDICTION_CERTIFICATES,
        *CATCH_CERTIFICATES,
        *FAMILY_CERTIFICATES,
    }
    counts = [CERTIFICATES, PREDICTION_CERTIFICATES, CATCH_CERTIFICATES + FAMILY_CERTIFICATES]
    assert [len(names) for names in counts] == [6, 4, 2]
    for claim in ("Every scene has six certificates, each on", "has four more:", "Two others, where they apply,"):
        assert claim in text
    categories = [read_pack(files).category for files in list_packs()]
    suite = [category for category in categories if category is not Category.OPEN]
    baselines = baseline_run()
    assert baselines is not None
    right = Counter(score.key.agent for score in baselines.scores if score.is_correct)
    episodes = Counter(score.key.agent for score in baselines.scores)
    assert episodes["blind"] == episodes["random"] == len(suite)
    for claim in (
        f"of the {len(suite)} scenes, an agent that guesses from the prompt solves {right['blind']}, one that acts at"
        f" random solves {right['random']}, and the reference agent",
        f"{len(published_tools())} typed tools",
        f"{len(suite)} scenes in {len(set(suite))} categories",
        f"each on {min(scene.seeds for scene in certificates.scenes)} seeds",
    ):
        assert claim in text


def test_the_readme_is_short() -> None:
    assert len(README.read_text(encoding="utf-8").splitlines()) <= 150
