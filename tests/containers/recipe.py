"""Reads a Containerfile, and carries its steps out in a folder instead of a container: no engine is needed for that.

The folder stands for `/` of every stage, so a stage finds what another has made under the same path. Absolute paths of
the recipe are led into the folder. Users, ports and the base image are not imitated: an interpreter of this machine
stands for the image's.
"""

import json
import os
import re
import shlex
import shutil
import subprocess
import venv
from dataclasses import dataclass
from pathlib import Path

_PLACES = re.compile(r"(?<![\w./~-])/(src|wheel|opt|runs)\b")


@dataclass(frozen=True, slots=True)
class Instruction:
    """A line of a Containerfile, with the lines that continue it."""

    name: str
    rest: str

    @property
    def words(self) -> list[str]:
        """The words of the instruction: a JSON list, or as a shell splits them."""
        return json.loads(self.rest) if self.rest.startswith("[") else shlex.split(self.rest)


def stages(recipe: Path) -> dict[str, list[Instruction]]:
    """The stages of a Containerfile by name, each with its instructions; the first of them is FROM."""
    text = re.sub(r"^#.*\n", "", recipe.read_text(encoding="utf-8"), flags=re.MULTILINE)
    found: dict[str, list[Instruction]] = {}
    current: list[Instruction] = []
    for line in re.sub(r"\\\n\s*", "", text).splitlines():
        name, _, rest = line.partition(" ")
        if name == "FROM":
            current = found.setdefault(rest.rpartition(" AS ")[2], [])
        if name:
            current.append(Instruction(name, rest.strip()))
    return found


class Machine:
    """A folder in which the steps of a Containerfile are carried out.

    Args:
        root: An empty folder, which stands for `/`.
        context: The checkout.
    """

    def __init__(self, root: Path, context: Path) -> None:
        self.root, self.context = root, context
        self._folder = root
        venv.create(root / "usr", with_pip=True)
        self._env = {name: value for name, value in os.environ.items() if name not in {"PYTHONPATH", "VIRTUAL_ENV"}}
        self._env["PATH"] = f"{root / 'usr' / 'bin'}{os.pathsep}{os.environ['PATH']}"

    def path(self, text: str) -> str:
        """A text with its absolute paths led into the folder."""
        return _PLACES.sub(lambda found: f"{self.root}{found[0]}", text)

    def build(self, instructions: list[Instruction]) -> None:
        """Carry out the steps of a stage.

        Raises:
            CalledProcessError: A command failed.
            ValueError: A step is of a kind that is not imitated.
        """
        for step in instructions:
            match step.name:
                case "RUN":
                    print(f"RUN {step.rest[:100]}", flush=True)
                    subprocess.run(["sh", "-ec", self.path(step.rest)], cwd=self._folder, env=self._env, check=True)
                case "COPY":
                    self._copy(step.words)
                case "WORKDIR":
                    self._folder = Path(self.path(step.rest))
                    self._folder.mkdir(parents=True, exist_ok=True)
                case "FROM" | "ARG" | "ENV" | "USER" | "EXPOSE" | "HEALTHCHECK" | "ENTRYPOINT" | "CMD":
                    pass
                case _:
                    raise ValueError(f"{step.name} is not imitated")

    def _copy(self, words: list[str]) -> None:
        sources, target = [word for word in words[:-1] if not word.startswith("--")], words[-1]
        if any(word.startswith("--from=") for word in words):
            # The stages share the folder, so the file is where it shall be.
            assert sources == [target], words
            assert Path(self.path(target)).exists(), words
            return
        for name in sources:
            source, led = self.context / name, self._folder / target
            if source.is_dir():
                shutil.copytree(source, led, ignore=shutil.ignore_patterns("__pycache__"))
            else:
                shutil.copy(source, led)

    def start(self, words: list[str], **variables: str) -> "subprocess.Popen[str]":
        """Start a command of an image.

        Args:
            words: The command.
            variables: What `--env` of an engine sets.
        """
        return subprocess.Popen(
            [self.path(word) for word in words],
            cwd=self._folder,
            env=self._env | variables,
            stdout=subprocess.PIPE,
            text=True,
        )


def only(instructions: list[Instruction], name: str) -> Instruction:
    """The one instruction of a stage that has this name."""
    (found,) = (step for step in instructions if step.name == name)
    return found
