"""Runs trials of Harbor without a container engine, in the environment of Harbor, on Linux as root.

harbor_trial.py FOLDER PLACES TASK AGENT...    prints a line of JSON for each agent: oracle, nop, or forger

A container is a folder with its own mount namespace. The containers of a task share a network; the verifier has none. A
container has the files that its Dockerfile copies; the folders of PLACES (JSON: `folders`, `path`, `python_path`)
replace the image. Harbor itself runs the agent, collects the log and runs the verifier.
"""

import asyncio
import json
import os
import re
import shlex
import shutil
import signal
import sys
import warnings
from pathlib import Path
from typing import Any

import yaml
from harbor.agents.base import BaseAgent
from harbor.agents.capabilities import AgentCapabilities
from harbor.environments.base import BaseEnvironment, ExecResult
from harbor.environments.capabilities import EnvironmentCapabilities
from harbor.models.trial.config import TrialConfig
from harbor.trial.trial import Trial

FOLDER = Path(sys.argv[1])
PLACES = json.loads(sys.argv[2])
SYSTEM = ["/usr", "/bin", "/lib", "/lib64", "/sbin", "/etc", "/dev", "/proc"]
MADE = ("tmp", "work", "logs/agent", "logs/artifacts", "logs/verifier")


class Container:
    """The files of a container."""

    def __init__(self, root: Path, context: Path) -> None:
        """Build it."""
        self.root = root
        text = (context / "Dockerfile").read_text(encoding="utf-8")
        for source, target in re.findall(r"^COPY (?:--\S+ )?(\S+) (\S+)$", text, re.MULTILINE):
            shutil.copytree(context / source, root / target.lstrip("/"))
        command = re.search(r"^CMD (\[.*\])$", text, re.MULTILINE)
        self.command: list[str] = json.loads(command[1]) if command else []
        for name in MADE:
            (root / name).mkdir(parents=True, exist_ok=True)
        (root / "hosts").write_text("127.0.0.1 localhost laboratory\n", encoding="utf-8")

    def script(self, command: str, variables: dict[str, str]) -> str:
        """Return a script that runs a command in the container, in existing mount and network namespaces."""
        lines: list[str] = []
        for folder in filter(os.path.isdir, [*SYSTEM, *PLACES["folders"]]):
            lines += [f"mkdir -p {self.root}{folder}", f"mount --rbind -o ro {folder} {self.root}{folder}"]
        lines += [f"mount --bind {self.root}/hosts {self.root}/etc/hosts"]
        own = {"PATH": PLACES["path"], "PYTHONPATH": PLACES["python_path"], "HOME": "/tmp"} | variables
        words = ["chroot", str(self.root), "/usr/bin/env", "-i", *(f"{name}={value}" for name, value in own.items())]
        return "\n".join([*lines, f"exec {shlex.join([*words, 'sh', '-c', f'cd /; {command}'])}"])


class Namespaces(BaseEnvironment):
    """The containers of a task, or of its verifier."""

    @staticmethod
    def type() -> str:
        """Its name."""
        return "namespaces"

    @property
    def capabilities(self) -> EnvironmentCapabilities:
        """The features that Harbor may use."""
        return EnvironmentCapabilities(docker_compose=True, disable_internet=True)

    def _validate_definition(self) -> None:
        assert (self.environment_dir / "Dockerfile").is_file()

    async def start(self, force_build: bool) -> None:
        """Build the containers, and start the laboratory."""
        del force_build
        folder = FOLDER / self.session_id
        self.containers = {"main": Container(folder / "main", self.environment_dir)}
        self.laboratory: asyncio.subprocess.Process | None = None
        compose = self.environment_dir / "docker-compose.yaml"
        if not compose.exists():
            return
        service = yaml.safe_load(compose.read_text(encoding="utf-8"))["services"]["laboratory"]
        built = Container(folder / "laboratory", self.environment_dir / service["build"]["context"])
        self.containers["laboratory"] = built
        script = "ip link set lo up\n" + built.script(shlex.join(built.command), {})
        self.laboratory = await asyncio.create_subprocess_exec(
            "unshare", "-n", "-m", "sh", "-c", script, start_new_session=True, stdout=asyncio.subprocess.DEVNULL
        )
        healthy = shlex.join(service["healthcheck"]["test"][1:])
        for _ in range(100):
            if (await self.service_exec(healthy, service="laboratory")).return_code == 0:
                return
            await asyncio.sleep(0.2)
        raise RuntimeError("the laboratory is not healthy")

    async def stop(self, delete: bool) -> None:
        """End the laboratory."""
        del delete
        if self.laboratory is not None:
            os.killpg(self.laboratory.pid, signal.SIGTERM)
            await self.laboratory.wait()

    async def stop_service(self, service: str) -> None:
        """End a container."""
        del self.containers[service]

    async def exec(self, command: str, *_: Any, env: dict[str, str] | None = None, **__: Any) -> ExecResult:
        """Run a command in the main container."""
        return await self.service_exec(command, env=env)

    async def service_exec(
        self, command: str, *, service: str | None = None, env: dict[str, str] | None = None, **_: Any
    ) -> ExecResult:
        """Run a command in a container."""
        script = self.containers[service or "main"].script(command, env or {})
        network = ["unshare", "-n"] if self.laboratory is None else ["nsenter", "-t", str(self.laboratory.pid), "-n"]
        pipe = asyncio.subprocess.PIPE
        process = await asyncio.create_subprocess_exec(
            *network, "unshare", "-m", "sh", "-c", script, stdout=pipe, stderr=pipe
        )
        out, err = await process.communicate()
        return ExecResult(stdout=out.decode(), stderr=err.decode(), return_code=process.returncode or 0)

    def _at(self, path: str, service: str | None = None) -> Path:
        return self.containers[service or "main"].root / str(path).lstrip("/")

    async def upload_file(self, source_path: Path | str, target_path: str) -> None:
        """Copy a file into the main container."""
        shutil.copy(source_path, self._at(target_path))

    async def upload_dir(self, source_dir: Path | str, target_dir: str) -> None:
        """Copy a folder into the main container."""
        shutil.copytree(source_dir, self._at(target_dir), dirs_exist_ok=True)

    async def download_file(self, source_path: str, target_path: Path | str) -> None:
        """Copy a file from the main container."""
        shutil.copy(self._at(source_path), target_path)

    async def download_dir(self, source_dir: str, target_dir: Path | str) -> None:
        """Copy a folder from the main container."""
        shutil.copytree(self._at(source_dir), target_dir, dirs_exist_ok=True)

    async def service_download_file(
        self, source_path: str, target_path: Path | str, *, service: str | None = None
    ) -> None:
        """Copy a file from a container."""
        assert service == "main" or "main" not in self.containers, "the agent's container runs on"
        shutil.copy(self._at(source_path, service), target_path)

    async def service_is_dir(self, path: str, *, service: str | None = None, **_: Any) -> bool:
        """Whether a path in a container is a folder."""
        return self._at(path, service).is_dir()


class Forger(BaseAgent):
    """An agent that writes a log and rewards as root, and requests private data from the laboratory."""

    capabilities = AgentCapabilities(mcp_servers=True)

    @staticmethod
    def name() -> str:
        """Its name."""
        return "forger"

    def version(self) -> str:
        """Its version."""
        return "1"

    async def setup(self, environment: BaseEnvironment) -> None:
        """Nothing to install."""

    async def run(self, instruction: str, environment: BaseEnvironment, context: Any) -> None:
        """Forge files and call the laboratory without a token."""
        call = {"tool": "answer", "arguments": {"answer": 250}, "returned": True, "is_error": False, "content": None}
        log = json.dumps({"ended": True, "calls": [call | {"text": "", "started_s": 0, "duration_s": 0}]})
        for path in ("/laboratory/calls.json", "/logs/artifacts/laboratory/calls.json"):
            await environment.exec(f"mkdir -p $(dirname {path}); echo {shlex.quote(log)} > {path}")
        for path in ("/logs/verifier/reward.json", "/logs/artifacts/reward.json", "/tests/test.sh"):
            await environment.exec(f"mkdir -p $(dirname {path}); echo '{{\"reward\": 1}}' > {path}")
        code = """if True:
            import urllib.error, urllib.request
            for method, path in (("POST", ""), ("GET", "/0/calls"), ("DELETE", "/0")):
                request = urllib.request.Request("http://laboratory:8000/episodes" + path, method=method)
                try:
                    print(urllib.request.urlopen(request).status)
                except urllib.error.HTTPError as error:
                    print(error.code)
        """
        done = await environment.exec(shlex.join(["python3", "-c", code]))
        seen = await environment.exec("ls -d /laboratory/scenes /solution")
        print(json.dumps({"statuses": (done.stdout or "").split(), "seen": (seen.stdout or "").split()}), flush=True)


async def play(task: str, agent: str) -> dict[str, Any]:
    """The rewards of a trial."""
    here = Path(__file__).stem
    chosen = {"import_path": f"{here}:Forger"} if agent == "forger" else {"name": agent}
    environment = {"import_path": f"{here}:Namespaces"}
    wanted = {"task": {"path": task}, "trials_dir": str(FOLDER / "trials"), "agent": chosen, "environment": environment}
    trial = await Trial.create(TrialConfig.model_validate(wanted))
    result = await trial.run()
    failure = result.exception_info.exception_message if result.exception_info else None
    return {"rewards": result.verifier_result.rewards if result.verifier_result else None, "failure": failure}


if __name__ == "__main__":
    warnings.simplefilter("ignore")
    for played in sys.argv[4:]:
        print(json.dumps({"agent": played, **asyncio.run(play(sys.argv[3], played))}), flush=True)
