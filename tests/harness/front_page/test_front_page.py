"""Tests that the README shows a real episode: its transcript and the caption of its film are regenerated."""

import re
from collections import Counter
from pathlib import Path

import pytest
from PIL import Image, ImageChops

from evaluator.certify.records import (
    CATCH_CERTIFICATES,
    CERTIFICATES,
    FAMILY_CERTIFICATES,
    PREDICTION_CERTIFICATES,
    read_certificates,
)
from evaluator.records.episode import Verdict
from evaluator.report.baselines import baseline_run
from physment_mcp.serving.server import published_tools
from scenes import Category, default_folder, list_packs, read_pack
from tests.builders.paths import ROOT
from tests.harness.front_page.episode import SCENE, Played, block, caption, played, story, title, transcript
from tests.harness.front_page.frames import FILM_S, frames_of
from tests.harness.front_page.make import DESCRIPTION, PICTURES, as_ascii

README = ROOT / "README.md"
LARGEST_BYTES, LARGEST_FILM_BYTES = 150_000, 400_000


@pytest.fixture(scope="module")
def episode(tmp_path_factory: pytest.TempPathFactory) -> Played:
    return played(tmp_path_factory.mktemp("front") / "run")


def with_episode(readme: str, episode: Played) -> str:
    """The README with the transcript of an episode, and with its caption as the text of the first picture."""
    readme = re.sub(r"```text\n.*?```", lambda _: block(transcript(episode)), readme, count=1, flags=re.DOTALL)
    return re.sub(r'alt="[^"]*"', lambda _: f'alt="{caption(episode)}"', readme, count=1)


def test_the_readme_shows_the_transcript_of_a_real_episode(episode: Played, update_goldens: bool) -> None:
    text = README.read_text(encoding="utf-8")
    if update_goldens:
        README.write_text(with_episode(text, episode), encoding="utf-8")
        text = README.read_text(encoding="utf-8")
    assert with_episode(text, episode) == text


def test_the_transcript_has_at_most_twenty_lines_that_fit_the_page(episode: Played) -> None:
    lines = transcript(episode)
    assert len(lines) <= 20
    assert max(map(len, lines)) <= 100


def test_the_answer_follows_from_the_readings_that_the_film_shows(episode: Played) -> None:
    told = story(episode)
    assert told.before == pytest.approx(told.push_n * told.push_s)
    assert told.answer == pytest.approx((told.before - told.red) / told.blue, abs=5e-4)
    assert episode.grade.grade.strict is Verdict.CORRECT
    assert round(told.answer, 2) == round((round(told.before, 2) - round(told.red, 2)) / round(told.blue, 2), 2), (
        "the sum with the rounded numbers of the film gives another answer"
    )


def test_the_film_shows_every_reading_after_its_call_and_lasts_six_seconds(episode: Played) -> None:
    frames = frames_of(episode)
    assert sum(frame.duration_ms for frame in frames) == round(1000 * FILM_S) == 6000
    assert frames[-1].duration_ms >= 1500, "time to read the answer"
    assert [frame.time for frame in frames] == sorted(frame.time for frame in frames)
    told = story(episode)
    pushed, collided = told.push_s, told.push_s + told.run_s
    for frame in frames:
        read = [line.read for line in frame.lines if line.read]
        assert len(read) <= sum(frame.time >= when - 1e-9 for when in (pushed, collided, collided))
        assert bool(frame.push) <= (frame.time < pushed)
        assert ("?" in frame.mass) is (len(read) < 3)
    red = {round(frame.time, 2): frame.poses["object_1"][0] for frame in frames}
    assert red[round(pushed, 2)] == pytest.approx(told.before * pushed / 2, rel=0.02)


def test_the_episode_is_not_taken_for_one_of_a_scene_of_the_suite(episode: Played) -> None:
    assert SCENE not in {files.scene_id for files in list_packs()}
    shown = (title(episode.episode), caption(episode), *transcript(episode))
    assert [text for text in shown if re.search(r"\bscene\b", text, re.IGNORECASE)] == []


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_the_film_and_its_still_are_of_this_episode(episode: Played, scheme: str) -> None:
    """If this fails, the scene has changed: run `python -m tests.harness.front_page.make --only episode` again."""
    with Image.open(PICTURES / f"episode-{scheme}.webp") as film, Image.open(still(scheme)) as picture:
        assert film.getexif()[DESCRIPTION] == picture.getexif()[DESCRIPTION] == as_ascii(caption(episode))
        durations: list[int] = []
        for number in range(film.n_frames):
            film.seek(number)
            film.load()
            durations.append(film.info["duration"])
        assert sum(durations) == round(1000 * FILM_S)
        assert ImageChops.difference(film.convert("RGBA"), picture.convert("RGBA")).getbbox() is None


def still(scheme: str) -> Path:
    return PICTURES / f"episode-still-{scheme}.webp"


def test_readers_who_prefer_reduced_motion_get_the_still() -> None:
    first = README.read_text(encoding="utf-8").partition("</picture>")[0]
    sources = re.findall(r'<source media="([^"]+)" srcset="docs/pictures/([^"]+)">', first)
    assert sources == [
        ("(prefers-reduced-motion: reduce) and (prefers-color-scheme: dark)", "episode-still-dark.webp"),
        ("(prefers-reduced-motion: reduce)", "episode-still-light.webp"),
        ("(prefers-color-scheme: dark)", "episode-dark.webp"),
    ]


def test_every_picture_is_small_and_shown_by_the_readme_or_a_guide() -> None:
    files = sorted(PICTURES.iterdir())
    pages = [README, *(ROOT / "docs" / "how-to").glob("*.md")]
    shown = {
        (page.parent / name).resolve()
        for page in pages
        for name in re.findall(r'(?:src|srcset)="([^"]+)"', page.read_text(encoding="utf-8"))
    }
    assert sorted(shown) == files
    films = {PICTURES / f"episode-{scheme}.webp" for scheme in ("light", "dark")}
    limits = {file: LARGEST_FILM_BYTES if file in films else LARGEST_BYTES for file in files}
    assert [file.name for file, most in limits.items() if file.stat().st_size > most] == []


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
    for claim in ("Every scene has six certificates, each tested on", "has four more:", "Some scenes have two others:"):
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
        f"each tested on {min(scene.seeds for scene in certificates.scenes)} seeds",
    ):
        assert claim in text


def test_the_readme_is_short() -> None:
    assert len(README.read_text(encoding="utf-8").splitlines()) <= 150
