"""Tests of animated images: they show every call and the motion in between, and their size is bounded."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from evaluator.certify.moving_pictures import Moment, Shown
from evaluator.certify.processes import NoRenderer, renderers
from evaluator.commands.film import WEBP
from evaluator.commands.program import main
from evaluator.films.animation import MOST_FRAMES, animation_of
from evaluator.report.attachments import film_file, regular_file
from evaluator.report.film_record import MOST_BYTES, Film, read, written
from evaluator.store.run_folder import RunFolder
from tests.builders.films import Turns, attached_run, key_of, stored_run
from tests.builders.records import call

LOOK = call("get_position", object_id="object_1")
FALL = [
    [call("step", duration=0.5), LOOK],
    [call("create_objects", name="ball", pos=[3, 0, 30], density=1000, rgba=[1, 0, 0, 1], radius=0.2)],
    [call("reset"), call("step", duration=0.2), call("answer", answer=1)],
]
FALL_KEY = key_of(7, FALL)
UNSEEN = [[LOOK, call("apply_force", object_id="object_1", force_vector=[0, 2, 0])], [call("step", duration=0.3), LOOK]]
UNSEEN_KEY = key_of(82, UNSEEN)


def can_render() -> bool:
    try:
        with renderers(1):
            return True
    except NoRenderer:
        return False


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> RunFolder:
    made = stored_run(tmp_path_factory.mktemp("webp") / "run", (FALL_KEY, FALL), (UNSEEN_KEY, UNSEEN))
    assert main(["film", str(made.path)]) == 0
    return made


def film_of(run: RunFolder, key: object) -> Film:
    (record,) = [record for found, record in run.line_hashes().items() if found == key]
    return read(regular_file(film_file(run.path, record), MOST_BYTES), record)


def moments_of(run: RunFolder, key: object) -> list[Moment]:
    (episode,) = [episode for found, episode in run.episodes().items() if found == key]
    return list(animation_of(film_of(run, key), episode, "title").moments)


def test_every_call_is_a_frame_and_time_passes_between_in_equal_steps(run: RunFolder) -> None:
    moments = moments_of(run, FALL_KEY)
    asked = [moment.captions[1] for moment in moments]
    assert list(dict.fromkeys(asked)) == [
        "before the first call",
        "iteration 1 of 3: step 0.5 s",
        "iteration 1 of 3: get_position object_1",
        "iteration 2 of 3: create_objects ball, at (3, 0, 30) m, density 1000 kg/m³, radius 0.2 m",
        "iteration 3 of 3: reset",
        "iteration 3 of 3: step 0.2 s",
        "iteration 3 of 3: answer 1",
    ]
    falling = [moment for moment in moments if moment.captions[1] == asked[1]]
    heights = np.array([moment.poses["object_1"][2] for moment in falling])
    times = np.array([float(moment.clock.split()[0]) for moment in falling])
    assert len(falling) > 10
    assert heights == pytest.approx(heights[0] - 4.905 * (times**2 - times[0] ** 2), abs=0.06)
    assert {moment.clock.split(", ")[1] for moment in moments} == {"4 times slower"}
    assert moments[-1].duration_ms > 2000
    assert ["ball" in moment.poses for moment in moments] == [moment.shown == 1 for moment in moments]


def test_a_film_of_other_calls_is_refused(run: RunFolder) -> None:
    film, played = film_of(run, FALL_KEY), run.episodes()[FALL_KEY]
    for calls in (film.calls[:-1], (film.calls[0][:-1], *film.calls[1:])):
        with pytest.raises(ValueError, match="its film shows other calls"):
            animation_of(film.model_copy(update={"calls": calls}), played, "title")


def test_an_object_that_is_not_watched_is_where_it_was_read_last(run: RunFolder) -> None:
    moments = moments_of(run, UNSEEN_KEY)
    episode = run.episodes()[UNSEEN_KEY]
    first, last = (exchange.content for turn in episode.turns for exchange in turn.exchanges if exchange.call == LOOK)
    assert first
    assert last
    read = [moment.read["object_1"] if moment.read else None for moment in moments]
    assert read[0] is None
    assert read[1] is not None
    assert [*read[1].position] == first["position"]
    assert read[-1] is not None
    assert [*read[-1].position] == last["position"]
    assert {tuple(one.position) for one in read if one} == {tuple(first["position"]), tuple(last["position"])}
    assert read[-1].words.startswith("puck (object_1), last read (")
    assert all(moment.poses == {} for moment in moments)


def test_a_long_episode_has_a_bounded_number_of_frames_and_lasts_as_long(tmp_path: Path) -> None:
    turns: Turns = [[LOOK] * 40 for _ in range(10)]
    key = key_of(7, turns)
    run = stored_run(tmp_path / "run", (key, turns))
    assert main(["film", str(run.path)]) == 0
    moments = moments_of(run, key)
    assert 100 <= len(moments) <= MOST_FRAMES
    assert moments[-1].captions[1] == "iteration 10 of 10: get_position object_1"
    assert sum(moment.duration_ms for moment in moments) == pytest.approx(1000 + 399 * 50 + 2500)


@pytest.mark.skipif(not can_render(), reason="nothing renders off-screen here")
def test_the_image_is_written_where_the_command_says_and_the_report_leaves_it_alone(
    run: RunFolder, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["film", str(run.path), "--episode", "7", "--webp"]) == 0
    (file,) = (run.path / WEBP).iterdir()
    assert f"{file}: " in capsys.readouterr().out.replace("\n", "")
    assert file.name.startswith("scene7-seed0-")
    moments = moments_of(run, FALL_KEY)
    with Image.open(file) as image:
        assert (image.format, image.size[0], image.info["loop"]) == ("WEBP", 600, 0)
        assert 10 < image.n_frames <= len(moments)
        frames = [np.asarray(image.convert("RGB")).astype(int) for k in range(image.n_frames) if image.seek(k) is None]
    # Something falls, and the captions change.
    assert all(len({frame[rows].tobytes() for frame in frames}) > 4 for rows in (slice(0, 400), slice(400, None)))
    assert attached_run(run).attachments.left_out == ()


@pytest.mark.skipif(not can_render(), reason="nothing renders off-screen here")
def test_a_film_without_an_image_is_reported_and_the_others_get_theirs(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = stored_run(tmp_path / "run", (FALL_KEY, FALL), (UNSEEN_KEY, UNSEEN))
    assert main(["film", str(run.path)]) == 0
    film = film_of(run, FALL_KEY)
    shortened = film.model_copy(update={"calls": film.calls[:-1]})
    film_file(run.path, film.episode).write_bytes(written(shortened))
    assert main(["film", str(run.path), "--webp"]) == 1
    assert "scene 7" in (told := capsys.readouterr().err)
    assert "gives no animated image: its film shows other calls" in told
    assert [file.name.partition("-")[0] for file in (run.path / WEBP).iterdir()] == ["scene82"]


@pytest.mark.skipif(not can_render(), reason="nothing renders off-screen here")
def test_nothing_drawn_at_all_still_has_its_captions_and_too_large_an_image_is_refused() -> None:
    moments = [Moment(0, {}, {}, ["title", f"call {k}"], "0.00 s", 100) for k in range(3)]
    with renderers(1) as pool:
        assert pool.submit(drawn, [Shown([], [], {})], moments, 1_000_000).result()[8:12] == b"WEBP"
        with pytest.raises(ValueError, match="more than 100 bytes"):
            pool.submit(drawn, [Shown([], [], {})], moments, 100).result()


def drawn(things: list[Shown], moments: list[Moment], most_bytes: int) -> bytes:
    from evaluator.certify.moving_pictures import moving_plate  # after the choice of the graphics library

    return moving_plate(things, moments, most_bytes)


def test_a_machine_without_a_renderer_is_told_what_to_install(
    run: RunFolder, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("MUJOCO_GL", "none")
    assert main(["film", str(run.path), "--episode", "7", "--webp"]) == 2
    assert "nothing draws off-screen here (MUJOCO_GL as none); install libosmesa6" in capsys.readouterr().err
