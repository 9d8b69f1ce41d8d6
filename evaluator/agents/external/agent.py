"""External agents: any program that speaks MCP, given the address of an episode and judged by the host's own log.

The program drives itself: it has no turns that could be seen, so its budget is one of calls, and the laboratory holds
it. What the program says counts for nothing but its reasoning; its answer is the one the laboratory took down.
"""

import json
import os
import re
import shlex
import shutil
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from urllib.parse import urlsplit

import anyio
from pydantic import JsonValue

from evaluator.agents.external.child_process import Ended, run_child
from evaluator.agents.external.watched import WatchedEpisode, watch_episode
from evaluator.episode.connect import TOKEN_VARIABLE, HostLaboratory, Laboratory
from evaluator.episode.player import ANSWER
from evaluator.errors import AgentError, UsageError
from evaluator.records import Episode, EpisodeKey, Outcome, Turn, Versions
from scenes import PackError, default_folder, list_packs

CALLS_PER_ITERATION = 10
"""Calls allowed for each iteration of the budget, unless told otherwise."""
_FAILURE = 600
"""Characters that are kept of why a program failed."""
_REASONING = 20_000
"""Last characters of its output that are kept as reasoning."""
_LOCAL = {"localhost", "127.0.0.1", "::1"}
_OWN_VARIABLES = {"PWD", "OLDPWD", "PYTHONPATH", "PYTHONHOME", "VIRTUAL_ENV", "CONDA_PREFIX", "_"}
_SECRET = re.compile(r"KEY|TOKEN|SECRET|PASSWORD|PASSWD|CREDENTIAL", re.IGNORECASE)
_PLACE = re.compile(r"\{(mcp_config|mcp_url|prompt)\}")


@dataclass(frozen=True, slots=True)
class ExternalAgent:
    """A command that plays an episode by itself."""

    command: tuple[str, ...]
    """Program and arguments; may hold `{mcp_config}`, `{mcp_url}` and `{prompt}`."""
    unsealed: str | None
    """Why it could read the scene packs, and with them the answers; None if it could not."""
    max_calls: int | None = None
    """Most tool calls; None for ten for each iteration of the budget."""
    max_wall_s: float = 1800.0
    """Wall time for an episode [s]."""
    grace_s: float = 10.0
    """Wall time it may take to end by itself once nothing more can be called [s]."""
    scenes_dir: Path | None = None
    """The packs played, of which its environment must say nothing."""

    @property
    def name(self) -> str:
        """`external:` or `external-unsealed:`, and its program: the two are never the same cell of a matrix."""
        return f"external{'-unsealed' if self.unsealed else ''}:{Path(self.command[0]).name}"

    def facts(self) -> dict[str, JsonValue]:
        """What of it decides a result, for `run.json`: the command, without secrets, and its bounds."""
        return {
            "command": [without_secrets(word, os.environ) for word in self.command],
            "max_calls": self.max_calls,
            "max_wall_s": self.max_wall_s,
            "unsealed": self.unsealed,
        }

    def calls_for(self, budget: int) -> int:
        """Calls it may make under a budget of iterations."""
        return self.max_calls or CALLS_PER_ITERATION * budget


def parse_external(
    words: Sequence[str],
    server: str,
    scenes_dir: Path | None,
    *,
    vouched: bool = False,
    max_calls: int | None = None,
    max_wall_s: float = 1800.0,
    environ: Mapping[str, str] = os.environ,
) -> ExternalAgent:
    """The agent that `--agent external -- COMMAND` names.

    Args:
        words: COMMAND, in words.
        server: What `--server` says.
        scenes_dir: What `--scenes-dir` says.
        vouched: The operator vouches that no scene pack can be read where COMMAND runs.
        max_calls: Most tool calls in an episode; None for ten for each iteration of the budget.
        max_wall_s: Most wall time for an episode [s].
        environ: Tells whether we have a token for the host.

    Raises:
        UsageError: The command is missing, cannot be found or could not find the laboratory.
    """
    if not words:
        raise UsageError(
            "--agent external needs a command after --, such as: -- my-agent --mcp-config {mcp_config} --print {prompt}"
        )
    if not any(place in word for word in words for place in ("{mcp_config}", "{mcp_url}")):
        raise UsageError(
            f"the command {shlex.join(words)!r} could not find the laboratory: write {{mcp_config}} (path of a client"
            " configuration) or {mcp_url} (address of the episode) where it takes one"
        )
    if server != "host" and not server.startswith(("http://", "https://")):
        raise UsageError("--agent external needs a laboratory with an address: --server host, or the URL of a host")
    program = shutil.which(words[0])
    if program is None:
        raise UsageError(f"there is no program {words[0]!r}")
    for word in words[1:]:
        if not Path(word).is_absolute() and Path(word).is_file():
            raise UsageError(
                f"{word}: the command runs in an empty folder, so write the path in full: {Path(word).resolve()}"
            )
    command = (str(Path(program).absolute()), *words[1:])
    return ExternalAgent(
        command,
        _why_unsealed(server, scenes_dir, guarded=TOKEN_VARIABLE in environ, vouched=vouched),
        max_calls,
        max_wall_s,
        scenes_dir=scenes_dir,
    )


def _why_unsealed(server: str, scenes_dir: Path | None, *, guarded: bool, vouched: bool) -> str | None:
    """Why a program we start could know more than it measures; None if it could not, as far as we know or are told."""
    if server != "host" and not guarded:  # our own host is
        return (
            f"anybody may open episodes on the host, to practise in them unseen; {TOKEN_VARIABLE} holds no token for it"
        )
    if vouched:
        return None
    folder = scenes_dir or default_folder()
    try:
        readable = any(os.access(files.json, os.R_OK) for files in list_packs(folder))
    except PackError:
        readable = False
    if readable:
        return f"it runs as this user, who can read the scene packs in {folder}"
    if server == "host" or urlsplit(server).hostname in _LOCAL:
        return "the host of the laboratory is on the machine where it runs"
    return None


async def play_external(agent: ExternalAgent, laboratory: Laboratory, key: EpisodeKey, versions: Versions) -> Episode:
    """Let a program play one episode to its end.

    Args:
        agent: Which program.
        laboratory: A host, whose address the program can be given.
        key: Which episode this is.
        versions: Recorded with the episode.

    Returns:
        The episode, a turn for each call; what the program wrote last on its output is the reasoning of the last turn.

    Raises:
        InfrastructureError: The host failed; the episode has no outcome and may be played again.
        UsageError: The laboratory has no address.
    """
    if not isinstance(laboratory, HostLaboratory):
        raise UsageError("--agent external needs a laboratory with an address: --server host, or the URL of a host")
    started_at, clock = datetime.now(UTC).isoformat(timespec="milliseconds"), time.perf_counter()
    max_calls = agent.calls_for(key.budget)
    environment = child_environment(os.environ, agent.scenes_dir)
    async with watch_episode(laboratory, key.scene, key.seed, max_calls) as episode:
        prompt = f"{await episode.prompt(key)}\n\n{_rules(max_calls, agent.max_wall_s)}"
        ended: Ended | None = None
        failure = ""
        try:
            ended = await _run(agent, episode, prompt, environment)
        except AgentError as error:
            failure = str(error)
        turns = await episode.turns()
    outcome, answer = _outcome(turns, max_calls)
    if outcome is Outcome.AGENT_ERROR and ended is not None:
        # Cut after the secrets are out: half of one would not be known for what it is.
        failure = without_secrets(_how_it_ended(agent, ended, len(turns), max_calls), environment)[:_FAILURE]
    said = without_secrets(ended.stdout, environment)[-_REASONING:].strip() if ended else ""
    return Episode(
        key=key,
        outcome=outcome,
        answer=answer,
        prompt=prompt,
        turns=_with_reasoning(turns, said),
        error=failure if outcome is Outcome.AGENT_ERROR else None,
        unsealed=agent.unsealed,
        max_calls=max_calls,
        started_at=started_at,
        duration_s=time.perf_counter() - clock,
        versions=versions,
    )


async def _run(agent: ExternalAgent, episode: WatchedEpisode, prompt: str, environment: Mapping[str, str]) -> Ended:
    """Run the command in an empty folder until it ends, is out of time, or is of no more use."""

    async def useless() -> None:
        if await episode.until_end():
            await anyio.sleep(agent.grace_s)

    with tempfile.TemporaryDirectory(prefix="mcp-") as beside, tempfile.TemporaryDirectory(prefix="work-") as work:
        config = Path(beside) / "mcp.json"
        config.write_text(json.dumps(client_config(episode.mcp_url), indent=2) + "\n", encoding="utf-8")
        places = {"mcp_config": str(config), "mcp_url": episode.mcp_url, "prompt": prompt}
        # In one pass, so that braces in the prompt stay what they are.
        command = [_PLACE.sub(lambda found: places[found[1]], word) for word in agent.command]
        try:
            return await run_child(
                command,
                cwd=Path(work),
                env=environment,
                stdin=None if any("{prompt}" in word for word in agent.command) else prompt,
                max_wall_s=agent.max_wall_s,
                until=useless,
            )
        except OSError as error:
            raise AgentError(f"{agent.command[0]} cannot be started: {error.strerror or error}") from error


def client_config(mcp_url: str) -> dict[str, object]:
    """A configuration in the form that MCP clients share, with the laboratory as the one server."""
    return {"mcpServers": {"physment": {"type": "http", "url": mcp_url}}}


def _rules(max_calls: int, max_wall_s: float) -> str:
    return (
        "# Budget\n\nThe laboratory is the MCP server `physment`. You may make"
        f" {max_calls} tool calls, refused ones included, within {max_wall_s:g} s of wall time. If you have not called"
        " `answer` by then, the task counts as failed."
    )


def _outcome(turns: Sequence[Turn], max_calls: int) -> tuple[Outcome, JsonValue]:
    """How the episode ended by the log, and the answer."""
    for turn in turns:
        for one in turn.exchanges:
            if one.call.tool == ANSWER and one.returned and not one.is_error:
                return Outcome.ANSWERED, one.call.arguments["answer"]
    return (Outcome.BUDGET_EXHAUSTED if len(turns) >= max_calls else Outcome.AGENT_ERROR), None


def _how_it_ended(agent: ExternalAgent, ended: Ended, calls: int, max_calls: int) -> str:
    """The sentence for a program that gave no answer though it could have."""
    program = Path(agent.command[0]).name
    if ended.out_of_time:
        return f"{program} gave no answer within {agent.max_wall_s:g} s and was stopped"
    said = [line.strip() for line in ended.stderr.splitlines() if line.strip()]
    if ended.code:
        return f"{program} ended with code {ended.code}{f': {said[-1]}' if said else ''}"
    return f"{program} ended without an answer after {calls} of {max_calls} calls"


def _with_reasoning(turns: tuple[Turn, ...], said: str) -> tuple[Turn, ...]:
    """The turns, the last with what the program said; one turn without calls if it only spoke."""
    if not said:
        return turns
    last = turns[-1] if turns else Turn(reasoning="")
    return (*turns[:-1], last.model_copy(update={"reasoning": said}))


def child_environment(ours: Mapping[str, str], scenes_dir: Path | None) -> dict[str, str]:
    """An environment without what would tell where the packs and this program are.

    Args:
        ours: The environment to start from.
        scenes_dir: The packs played; None for the suite.
    """
    places = [str(place) for place in (scenes_dir and scenes_dir.absolute(), default_folder().parent) if place]

    def tells(value: str) -> bool:
        return any(place in value for place in places)

    path = os.pathsep.join(one for one in ours.get("PATH", os.defpath).split(os.pathsep) if not tells(one))
    kept = {
        name: value
        for name, value in ours.items()
        if name not in _OWN_VARIABLES and not name.startswith(("PHYSMENT", "PYTEST")) and not tells(value)
    }
    return kept | {"PATH": path}


def without_secrets(text: str, environment: Mapping[str, str]) -> str:
    """What a program wrote, with the names of secret variables of its environment in place of their values."""
    secrets = {value: name for name, value in environment.items() if _SECRET.search(name) and len(value) >= 8}
    for value in sorted(secrets, key=len, reverse=True):
        text = text.replace(value, f"[{secrets[value]}]")
    return text
