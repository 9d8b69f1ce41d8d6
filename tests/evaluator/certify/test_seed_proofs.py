"""Tests that seeds without a certificate are proved before they are played, and replaced or refused if they fail."""

import json
from pathlib import Path

import httpx
import pytest

from evaluator.answers.keys import KeyRing
from evaluator.certify.records import SceneCertificate, certificates_of, check, write_certificates
from evaluator.certify.seed_proofs import SeedProver, prove
from evaluator.commands.program import main
from evaluator.commands.run import prove_seeds
from evaluator.episode.hosts import HostConnector
from evaluator.errors import RefusedRequest, UsageError
from evaluator.records.run import Plan, RunRecord, SeedKey, ServerRecord
from evaluator.referee.contract import WantedEpisode
from evaluator.referee.episodes import Referee
from evaluator.referee.requests import app
from evaluator.referee.selection import proved_variant, variant_of
from evaluator.store.run_folder import RunFolder
from evaluator.study.run_config import RunConfig
from scenes import Category, PackFiles, draw_knobs, find_pack, pack_hash, read_pack, write_new_scene
from scenes.splits import splits
from tests.builders.author import Author

CERTIFIED = 3
HEAVY_KG = 4.0
"""The reference of the tests answers wrongly for heavier carts."""


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return tmp_path / "cache" / "physment" / "seed-proofs"


@pytest.fixture
def files(tmp_path: Path) -> PackFiles:
    """A certified scene whose reference fails at the seeds at which the cart is heavy."""
    author = Author(tmp_path / "packs")
    write_new_scene(author.folder, 7, Category.EASY_SINGLE)
    files = find_pack(7, author.folder)
    author.replace(
        files.solution,
        'yield [answer(FORCE_N * PUSH_S / readings[-1]["velocity"][0])]',
        f'yield [answer(min({HEAVY_KG}, FORCE_N * PUSH_S / readings[-1]["velocity"][0]))]',
    )
    certify_falsely(files)
    return files


def certify_falsely(files: PackFiles) -> None:
    checks = tuple(check(name, []) for name in certificates_of(read_pack(files)))
    certificate = SceneCertificate(
        scene=7, name="a cart", category="easy-single", pack=pack_hash(files), seeds=CERTIFIED, checks=checks
    )
    write_certificates(files.folder.parent, [certificate])


def mass(files: PackFiles, seed: int) -> float:
    drawn = draw_knobs(files, read_pack(files), seed)["m"]
    assert isinstance(drawn, float)
    return drawn


def heavy(files: PackFiles, seeds: range) -> list[int]:
    return [seed for seed in seeds if mass(files, seed) > HEAVY_KG]


def light(files: PackFiles, seeds: range) -> list[int]:
    return [seed for seed in seeds if mass(files, seed) < HEAVY_KG]


def config(files: PackFiles, seeds: list[int], spare: range = range(0), *, unproved: bool = False) -> RunConfig:
    folder = files.folder.parent
    return RunConfig(scenes_dir=folder, packs=(files,), seeds=tuple(seeds), spare_seeds=spare, unproved=unproved)


def plan_of(run: RunConfig) -> Plan:
    return Plan(scenes=(7,), agents=("blind",), seeds=run.seeds)


def words(files: PackFiles, seeds: list[int], out: Path) -> list[str]:
    listed = ",".join(map(str, seeds))
    return ["--scenes-dir", str(files.folder.parent), "--scenes", "7", "--seeds", listed, "--out", str(out)]


def test_a_proof_compares_the_key_with_the_reference_and_the_engine(files: PackFiles) -> None:
    good, bad = light(files, range(3, 99))[0], heavy(files, range(3, 99))[0]
    assert [one.passed for one in prove(files, good)] == [True, True, True]
    (key, *others) = prove(files, bad)
    assert (key.name, key.passed) == ("key", False)
    assert key.reasons == (f"seed {bad}: the reference answered 4.0; the key is {mass(files, bad)}",)
    assert all(one.passed for one in others)
    Author(files.folder.parent).replace(files.solution, 'return knobs["m"]', 'return 1.1 * knobs["m"]')
    (key, *_) = prove(files, good)
    assert f"seed {good}: theory gives {1.1 * mass(files, good)}, the engine" in " ".join(key.reasons)


def test_a_start_that_tells_the_seed_is_not_proved(files: PackFiles) -> None:
    author = Author(files.folder.parent)
    author.edit(files, lambda pack: pack["apply"].update({"body[object_1].pos": ["m", 0, 1]}))
    failed = [one for one in prove(files, light(files, range(3, 99))[0]) if not one.passed]
    assert [one.name for one in failed] == ["twins"]


def test_a_count_of_seeds_is_filled_by_the_next_seed_that_is_proved(
    files: PackFiles, capsys: pytest.CaptureFixture[str]
) -> None:
    bad = heavy(files, range(3, 200))
    first = bad[0]
    spare = range(bad[1], 1000)  # the first replacement fails, too
    run = config(files, [0, first], spare)
    plan, proofs = prove_seeds(run, plan_of(run))
    other = next(seed for seed in spare if mass(files, seed) < HEAVY_KG)
    assert plan.replaced == {"7": {first: other}}
    assert [key.seed for key in plan.matrix()] == [0, other]
    assert proofs.proved == {"7": (other,)}
    assert set(proofs.left_out["7"]) == {first, *(seed for seed in bad if spare[0] <= seed < other)}
    assert set(proofs.left_out["7"].values()) == {"key"}
    said = capsys.readouterr().err
    assert f"scene 7, seed {first} cannot be proved (certificate key); seed {bad[1]} takes its place" in said
    assert Plan.model_validate_json(plan.model_dump_json()).matrix() == plan.matrix()


def test_a_named_seed_that_fails_is_refused_and_may_be_played_unproved(
    files: PackFiles, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bad = heavy(files, range(3, 99))[0]
    asked = words(files, [0, bad], tmp_path / "run")
    assert main(asked) == 2
    assert f"scene 7, seed {bad} cannot be proved (certificate key): leave it out" in capsys.readouterr().err
    assert not (tmp_path / "run").exists()
    assert main([*asked, "--unproved"]) == 0
    proofs = RunFolder(tmp_path / "run").read_run().seed_proofs
    assert proofs is not None
    assert (proofs.proved, proofs.unproved, proofs.left_out) == ({}, {"7": (bad,)}, {})


def test_certified_seeds_need_no_proof_and_those_of_uncertified_scenes_get_none(files: PackFiles, cache: Path) -> None:
    run = config(files, [0, 1, 2])
    plan, proofs = prove_seeds(run, plan_of(run))
    assert (plan, proofs.model_dump(mode="json")) == (plan_of(run), {})
    Author(files.folder.parent).replace(files.solution, "min(4.0,", "min(4.5,")  # invalidates the certificate
    run = config(files, [0, 7])
    assert prove_seeds(run, plan_of(run))[1].unproved == {"7": (0, 7)}
    assert not cache.exists()


def test_a_proof_is_kept_for_its_pack(files: PackFiles, cache: Path) -> None:
    good = light(files, range(3, 99))[0]
    run = config(files, [good])
    assert prove_seeds(run, plan_of(run))[1].proved == {"7": (good,)}
    (file,) = cache.iterdir()
    stored = json.loads(file.read_text(encoding="utf-8"))
    assert (stored["pack"], stored["seed"], "failed" in stored) == (pack_hash(files), good, False)
    # A cached proof is trusted, so the failure that is written into this one is reported.
    file.write_text(json.dumps(stored | {"failed": ["key"]}) + '\n{"torn', encoding="utf-8")
    with pytest.raises(UsageError, match=f"seed {good} cannot be proved"):
        prove_seeds(run, plan_of(run))
    others = [json.dumps(stored | {"failed": ["key"], name: "0"}) for name in ("engine", "physment", "held_back")]
    file.write_text("\n".join(others) + "\n", encoding="utf-8")
    assert prove_seeds(run, plan_of(run))[1].proved == {"7": (good,)}


def test_a_failure_is_not_cached(files: PackFiles, cache: Path) -> None:
    good, bad = light(files, range(3, 99))[0], heavy(files, range(3, 99))[0]
    run = config(files, [good, bad])
    with pytest.raises(UsageError, match=f"seed {bad} cannot be proved"):
        prove_seeds(run, plan_of(run))
    (file,) = cache.iterdir()
    assert [json.loads(line)["seed"] for line in file.read_text(encoding="utf-8").splitlines()] == [good]


def test_neither_cache_nor_message_tells_a_held_back_seed_or_its_key(
    files: PackFiles, cache: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    secret = SeedKey(b"k" * 32)
    seeds = {number: secret.seed(7, number) for number in range(60)}
    bad = next(number for number, seed in seeds.items() if mass(files, seed) > HEAVY_KG)
    folder = files.folder.parent
    run = RunConfig(scenes_dir=folder, packs=(files,), seeds=(bad,), spare_seeds=range(bad + 1, 60), seed_key=secret)
    plan, proofs = prove_seeds(run, plan_of(run).model_copy(update={"held_back": secret.commitment}))
    (replaced,) = plan.replaced["7"].items()
    assert replaced[0] == bad
    written = "".join(file.read_text(encoding="utf-8") for file in cache.iterdir())
    shown = written + capsys.readouterr().err + proofs.model_dump_json()
    assert f'"seed":{replaced[1]},' in written
    assert f'"seed":{bad},' not in written
    assert not [seed for seed in seeds.values() if str(seed) in shown]
    assert str(mass(files, seeds[bad])) not in shown


async def test_a_referee_opens_the_next_variant_of_a_split_and_refuses_a_named_seed(files: PackFiles) -> None:
    prover = SeedProver([files], files.folder.parent)
    train, count = splits()["train"], len(splits()["train"].scenes)
    bad = heavy(files, train.seeds[:99])[0]
    index = train.scenes.index(7) + count * train.seeds.index(bad)
    by_place = WantedEpisode(split="train", index=index)
    found = await proved_variant(prover, by_place, variant_of(by_place, held_back=False))
    assert found.seed == light(files, range(bad, bad + 99))[0]
    assert found == variant_of(WantedEpisode(split="train", index=found.index), held_back=False)
    for named in (WantedEpisode(scene=7, seed=bad), WantedEpisode(scene=7, seed=bad, split="train")):
        with pytest.raises(RefusedRequest, match=f"seed {bad} cannot be proved .*, so it is not opened"):
            await proved_variant(prover, named, variant_of(named, held_back=False))
    without = SeedProver([files], files.folder.parent, skip=True)
    assert (await proved_variant(without, named, variant_of(named, held_back=False))).seed == bad


async def test_a_referee_records_what_it_proved(host_url: str, tmp_path: Path) -> None:
    folder = RunFolder(tmp_path / "run")
    folder.create(resume=False)
    record = RunRecord(
        created_at="2026-01-01T00:00:00+00:00",
        plan=Plan(scenes=(7,), agents=("trainer",)),
        server=ServerRecord(option="host", protocol="x"),
        packs={"7": "p"},
        versions={"physment-mcp": "0"},
    )
    referee = Referee(HostConnector(host_url), KeyRing(), record, prover=SeedProver([find_pack(7)]), folder=folder)
    served = app(referee, None)
    async with (
        served.router.lifespan_context(served),
        httpx.AsyncClient(transport=httpx.ASGITransport(served), base_url="http://127.0.0.1") as http,
    ):
        for seed in (3, 10_005):
            opened = (await http.post("/episodes", json={"scene": 7, "seed": seed}, timeout=60)).json()
            headers = {"Authorization": f"Bearer {opened['owner_token']}"}
            end = {"end": "budget_exhausted"}
            await http.post(f"/episodes/{opened['episode_id']}/reward", json=end, headers=headers)
    proofs = referee.played_record().seed_proofs
    assert proofs is not None
    assert (proofs.proved, proofs.unproved) == ({"7": (10_005,)}, {})
