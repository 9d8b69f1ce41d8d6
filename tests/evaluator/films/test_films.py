"""Tests of films: they show the visible bodies at their poses after each call; an edited record gets no film."""

import base64
import itertools
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from evaluator.commands.program import main
from evaluator.films import motion
from evaluator.films.motion import Instant, reel
from evaluator.records.episode import Episode
from evaluator.report.attachments import FILMS
from evaluator.report.film_record import Film
from evaluator.store.run_folder import RunFolder
from tests.builders.films import attached_run, course, decoded, file_of, key_of, read_film, stored_run
from tests.builders.records import call

LOOK = call("get_position", object_id="object_1")
FALL = [
    [call("step", duration=0.2), LOOK],
    [call("step", duration=0.01), LOOK, call("step", duration=0.3), LOOK],
    [call("create_objects", name="ball", pos=[3, 0, 30], density=1000, rgba=[1, 0, 0, 1], radius=0.2)],
    [call("step", duration=0.2), call("delete_objects", object_id="ball"), call("answer", answer=1)],
]
FIND = [
    [call("step", duration=0.1)],
    [call("find_objects"), call("apply_force", object_id="object_2", force_vector=[6, 0, 0])],
    [call("step", duration=0.1), call("get_position", object_id="object_2"), call("answer", answer=2)],
]
FALL_KEY, FIND_KEY = key_of(7, FALL), key_of(21, FIND)


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> RunFolder:
    made = stored_run(tmp_path_factory.mktemp("films") / "run", (FALL_KEY, FALL), (FIND_KEY, FIND))
    assert main(["film", str(made.path)]) == 0
    return made


def test_every_reading_of_the_agent_is_where_the_film_shows_the_object(run: RunFolder) -> None:
    film, episode = read_film(run, FALL_KEY), run.episodes()[FALL_KEY]
    times, poses = decoded(film)
    checked = 0
    for turn, instants in zip(episode.turns, film["calls"], strict=True):
        for exchange, instant in zip(turn.exchanges, instants, strict=True):
            assert exchange.content is not None
            assert times[instant] == pytest.approx(exchange.content["sim_time"], abs=1e-6)
            if exchange.call == LOOK:
                assert poses["object_1"][instant][:3] == pytest.approx(exchange.content["position"], abs=film["step"])
                checked += 1
    assert checked == 3
    assert film["step"] == 1e-4, "of a scene of some metres"
    assert poses["object_1"][-1][3:] == pytest.approx([1, 0, 0, 0], abs=film["turn"])


def test_motion_is_decoded_as_in_the_browser_and_damage_is_refused(run: RunFolder) -> None:
    film = Film.model_validate(read_film(run, FALL_KEY))
    times, poses = decoded(read_film(run, FALL_KEY))
    found = motion.decoded(film)
    assert found.times.tolist() == pytest.approx(times)
    assert found.poses.keys() == poses.keys()
    assert all(one.tolist() == [pytest.approx(pose) for pose in poses[name]] for name, one in found.poses.items())
    early, late = (found.at(position)["object_1"] for position in (3, 4))
    assert found.at(3.25)["object_1"][:3] == pytest.approx(
        [0.75 * a + 0.25 * b for a, b in zip(early, late, strict=True)][:3]
    )
    short = film.model_copy(update={"data": film.data[: len(film.data) // 8 * 4]})
    with pytest.raises(ValueError, match="ends too early"):
        motion.decoded(short)
    with pytest.raises(ValueError, match="too many numbers"):
        motion.decoded(
            film.model_copy(update={"data": base64.b64encode(base64.b64decode(film.data) + b"\x02").decode()})
        )


def number(value: int) -> bytes:
    """Encode a positive integer as the motion of a film does."""
    digits = [value * 2 >> shift & 127 | 128 for shift in range(0, (value * 2).bit_length(), 7)]
    return bytes([*digits[:-1], digits[-1] & 127])


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"data": number(10**400)}, "too large a number"),
        ({"data": number(2**70_000)}, "too large a number"),
        ({"data": number(2**52) * 2}, "too large a number"),
        ({"data": number(2**52), "step": 1e300, "count": 1}, "leads too far"),
        ({"data": number(2**52), "turn": 1e308, "count": 1}, "leads too far"),
    ],
)
def test_a_motion_of_monstrous_numbers_is_refused(run: RunFolder, change: dict[str, Any], sentence: str) -> None:
    film = Film.model_validate(read_film(run, FALL_KEY)).model_copy(update={"bodies": ("object_1",), "count": 3})
    numbers = change["data"] * 8
    change = {**change, "data": base64.b64encode(numbers).decode()}
    with pytest.raises(ValueError, match=sentence):
        motion.decoded(film.model_copy(update=change))


def test_a_film_says_when_things_come_and_go(run: RunFolder) -> None:
    film = read_film(run, FALL_KEY)
    (made,), (_, deleted, _) = film["calls"][2:]
    shown = {instant: [body["id"] for body in film["drawings"][drawing]["bodies"]] for instant, drawing in film["cuts"]}
    assert shown == {0: ["object_1"], made: ["object_1", "ball"], deleted: ["object_1"]}


def test_a_hidden_object_is_in_a_film_from_its_discovery_on_and_in_a_revealed_film_from_the_start(
    run: RunFolder, tmp_path: Path
) -> None:
    film = read_film(run, FIND_KEY)
    ids = [[body["id"] for body in drawing["bodies"]] for drawing in film["drawings"]]
    assert ids == [["object_1"], ["object_1", "object_2"]]
    assert film["cuts"] == [[0, 0], [film["calls"][1][0], 1]]
    assert "revealed" not in film
    other = stored_run(tmp_path / "run", (FIND_KEY, FIND))
    assert main(["film", str(other.path), "--reveal"]) == 0
    revealed = read_film(other, FIND_KEY)
    assert revealed["revealed"]
    assert {body["id"] for body in revealed["drawings"][0]["bodies"]} >= {"object_1", "object_2"}
    assert decoded(revealed)[1]["object_2"][-1] == pytest.approx(decoded(film)[1]["object_2"][-1])


PUSHED = [
    [LOOK, call("apply_force", object_id="object_1", force_vector=[0, 2, 0])],
    [call("step", duration=0.3), call("answer", answer=[1, 1])],
]
"""Calls in scene 82, whose object may be read and is not drawn. Two seeds return the same to them."""


def test_a_film_shows_an_object_that_is_not_drawn_where_it_was_read_last_and_nothing_else_of_it(tmp_path: Path) -> None:
    looked = [*PUSHED[:1], [PUSHED[1][0], LOOK, PUSHED[1][1]]]
    films: list[dict[str, Any]] = []
    places: list[list[Any]] = []
    for number, (turns, seed) in enumerate(itertools.product((PUSHED, looked), (0, 7))):
        key = key_of(82, turns, seed)
        run = stored_run(tmp_path / str(number), (key, turns))
        assert main(["film", str(run.path)]) == 0
        films.append({name: part for name, part in read_film(run, key).items() if name != "episode"})
        returned = [one.content for turn in run.episodes()[key].turns for one in turn.exchanges if one.call == LOOK]
        places.append([content["position"] for content in returned if content])
    assert [[call, *read] for call, read in films[0]["read"]] == [[0, "object_1"]]
    assert films[0]["read"][0][1]["object_1"] == {"position": places[0][0], "time": 0}
    assert films[0] == films[1]
    assert places[2][-1] != places[3][-1], "the seeds differ where nobody looked"
    assert [call for call, _ in films[2]["read"]] == [0, 3]
    assert films[2]["read"][-1][1]["object_1"]["position"] == places[2][-1]
    assert films[2]["drawings"][0]["schematic"] == [{"kind": "cord", "points": [[0, 0, 0.5], "object_1"]}]
    assert films[2]["drawings"][0]["names"] == {"object_1": "puck"}


def test_a_film_of_an_edited_record_is_refused_with_its_place_and_the_others_are_made(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = stored_run(tmp_path / "run", (FALL_KEY, FALL), (FIND_KEY, FIND))
    found = run.episodes()
    text = found[FALL_KEY].model_dump_json().replace('"sim_time\\":0.21,', '"sim_time\\":0.22,')
    assert Episode.model_validate_json(text) != found[FALL_KEY]
    run.episodes_file.write_text(f"{text}\n{found[FIND_KEY].model_dump_json()}\n", encoding="utf-8")
    assert main(["film", str(run.path)]) == 1
    assert "scene 7, seed 0, x, budget 4, epoch 1, turn 2, call 1 (step): " in capsys.readouterr().err
    assert list(attached_run(run).attachments.films) == [FIND_KEY]


def test_an_episode_that_the_laboratory_cannot_begin_is_refused_and_the_others_are_filmed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The first episode cannot begin: its record has a value of `prompting` that this version does not support."""
    run = stored_run(tmp_path / "run", (FALL_KEY, FALL), (FIND_KEY, FIND))
    found = run.episodes()
    text = found[FALL_KEY].model_dump_json().replace('"prompting":"zero-shot"', '"prompting":"of-old"')
    run.episodes_file.write_text(f"{text}\n{found[FIND_KEY].model_dump_json()}\n", encoding="utf-8")
    assert main(["film", str(run.path)]) == 1
    assert "scene 7, seed 0, x, budget 4, epoch 1 cannot be played again: " in capsys.readouterr().err
    assert list(attached_run(run).attachments.films) == [FIND_KEY]


def test_only_films_that_are_missing_or_of_another_record_are_made(run: RunFolder) -> None:
    file = file_of(run, FALL_KEY)
    before, content = file.stat().st_mtime_ns, file.read_text(encoding="utf-8")
    assert main(["film", str(run.path), "--episodes", "scene=7"]) == 0
    assert file.stat().st_mtime_ns == before
    file.write_text(content.replace('"episode":"', '"episode":"0'), encoding="utf-8")
    assert main(["film", str(run.path)]) == 0
    assert file.read_text(encoding="utf-8") == content


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        ((), "holds no episodes"),
        (("--episodes", "seen=7"), "write conditions such as"),
        (("--episode", "8", "--webp"), "holds 2 episodes, such as scene 7, seed 0, x, budget 4, epoch 1, and none of"),
    ],
)
def test_what_cannot_be_filmed_is_refused_in_one_sentence(
    run: RunFolder, tmp_path: Path, words: tuple[str, ...], sentence: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["film", str(run.path if words else tmp_path), *words]) == 2
    assert sentence in capsys.readouterr().err
    assert not (tmp_path / FILMS).exists()


@given(st.lists(st.lists(st.floats(-1e4, 1e4), min_size=3, max_size=3), min_size=1, max_size=40))
def test_positions_are_kept_to_the_step_of_the_film(places: list[list[float]]) -> None:
    instants = [Instant(0.005 * k, 0, {"a": [*place, 1.0, 0.0, 0.0, 0.0]}) for k, place in enumerate(places)]
    film = reel(instants, [{"bodies": []}])
    times, poses = decoded(film)
    assert times == pytest.approx([instant.time for instant in instants])
    assert [pose[:3] for pose in poses["a"]] == [pytest.approx(place, abs=0.51 * film["step"]) for place in places]


def test_rest_and_steady_motion_take_hardly_any_bytes() -> None:
    steady = [Instant(0.01 * k, 0, {"a": [0.3 * k, 0, 1, 1, 0, 0, 0]}) for k in range(1000)]
    assert len(reel(steady, [{"bodies": []}])["data"]) < 80
    assert course(iter(b"\x00\x03"), 4) == [0, 0, 0, 0]


def test_workers_make_the_same_films_and_refuse_the_same_ones(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    turns = [[call("step", duration=0.05)], [call("answer", answer=1)]]
    keys = {key_of(7, turns, seed): turns for seed in range(16)}
    other = stored_run(tmp_path / "run", *keys.items())
    text = other.episodes_file.read_text(encoding="utf-8").replace('\\"sim_time\\":0.05', '\\"sim_time\\":0.06', 1)
    other.episodes_file.write_text(text, encoding="utf-8")
    assert main(["film", str(other.path), "--workers", "2"]) == 1
    said = capsys.readouterr()
    assert (said.out[:8], said.err.count("physment-eval: ")) == ("15 films", 1)
    made = {key: file_of(other, key).read_bytes() for key in keys if file_of(other, key).exists()}
    assert len(made) == 15
    for key in list(made)[:2]:
        file_of(other, key).unlink()
    assert main(["film", str(other.path), "--workers", "1"]) == 1
    assert made == {key: file_of(other, key).read_bytes() for key in made}
