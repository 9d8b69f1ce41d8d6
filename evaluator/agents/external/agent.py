"""External agents: any program that speaks MCP, named by `--agent external -- COMMAND`.

It receives the address of an episode, and the server logs its calls. The turns of such a program cannot be observed, so
its budget is a number of calls, which the server enforces. Its answer is the one that the server accepted. Its output
is recorded as reasoning and has no other effect.
"""

import json
import os
import re
import shlex
import shutil
import time
from collections.abc import Mapping, Sequence
from contextlib import AbstractAsyncContextManager, nullcontext
from dataclasses import dataclass, field
from pathlib import Path
from urllib.parse import urlsplit

import anyio
from pydantic import JsonValue

from evaluator.agents.external.child_process import Ended, run_child
from evaluator.agents.external.isolation import (
    TOKEN,
    URL,
    SystemUser,
    SystemUsers,
    child_environment,
    episode_folders,
    system_users,
)
from evaluator.agents.external.watched import WatchedEpisode, outcome_of, watch_episode
from evaluator.episode.connect import EpisodeConnector
from evaluator.episode.hosts import TOKEN_VARIABLE, HostConnector
from evaluator.errors import AgentError, UsageError
from evaluator.records.episode import Episode, EpisodeKey, Outcome, Turn, Usage, Versions, timestamp
from evaluator.store.redaction import Redaction
from scenes import PackError, default_folder, find_pack, list_packs, read_public

CALLS_PER_ITERATION = 10
"""Allowed calls per iteration of the budget, if neither the operator nor the scene sets a limit."""
NEEDS_ADDRESS = "--agent external needs a laboratory with an address: --server host, or the URL of a host"
_FAILURE = 600
"""Largest number of characters kept of a program's error message."""
_REASONING = 20_000
"""Number of characters kept from the end of the program's output, as reasoning."""
_PLACEHOLDER = re.compile(r"\{(mcp_config|mcp_url|prompt)\}")


@dataclass(frozen=True, slots=True)
class ExternalAgent:
    """A participant that runs a command. The command's program plays the episode by itself."""

    command: tuple[str, ...]
    """Program and arguments; `{mcp_config}`, `{mcp_url}` and `{prompt}` are replaced."""
    unsealed: str | None
    """Why the program could read the scene packs, and so the answers; None if it could not."""
    max_calls: int | None = None
    """Largest number of tool calls; None for the scene's limit, or ten per iteration of the budget."""
    max_wall_s: float = 1800.0
    """Wall time for an episode [s]."""
    grace_s: float = 10.0
    """Wall time for the program to exit after its last possible call [s]."""
    scenes_dir: Path | None = None
    """Folder of the scene packs; the program's environment must not mention it."""
    home: Path | None = None
    """Template folder copied into each episode's home folder; None for empty homes."""
    guarded: bool = False
    """Whether the episode requires a token in addition to its address."""
    users: SystemUsers = field(default_factory=SystemUsers, repr=False, compare=False)
    """System users that the command runs as."""

    @property
    def name(self) -> str:
        """`external:` or `external-unsealed:`, and the program's name.

        The prefixes keep isolated and unisolated runs of one program in separate rows of a report.
        """
        return f"external{'-unsealed' if self.unsealed else ''}:{Path(self.command[0]).name}"

    def facts(self) -> Mapping[str, JsonValue]:
        """The command without secrets, and its limits."""
        return {
            "command": [Redaction.of(os.environ).text(word) for word in self.command],
            "max_calls": self.max_calls,
            "max_wall_s": self.max_wall_s,
            "unsealed": self.unsealed,
        }

    def running(self) -> AbstractAsyncContextManager[object]:
        """Return an empty context: the episodes share no resource."""
        return nullcontext()

    def calls_for(self, scene: int, budget: int) -> int:
        """Largest number of calls in an episode.

        The operator's limit takes precedence. Without one, it is the scene's limit plus one call for the answer, which
        the scene does not count. If the scene has no limit either, it is ten calls per iteration of the budget.
        """
        if self.max_calls is not None:
            return self.max_calls
        limit = calls_allowed(scene, self.scenes_dir)
        return CALLS_PER_ITERATION * budget if limit is None else limit + 1

    async def play(
        self, laboratory: EpisodeConnector, key: EpisodeKey, versions: Versions, used: list[Usage]
    ) -> Episode:
        """Let the program play one episode to its end.

        Args:
            laboratory: A connector to an episode server with an address.
            key: Key of the episode.
            versions: Versions of software and pack to record with the episode.
            used: Not changed, since the evaluator does not know how many tokens a program uses.

        Returns:
            The episode with one turn per call. The end of the program's output is the reasoning of the last turn.

        Raises:
            InfrastructureError: The server failed; the episode has no outcome and may be played again.
            UsageError: The laboratory has no address.
        """
        del used
        if not isinstance(laboratory, HostConnector):
            raise UsageError(NEEDS_ADDRESS)
        started_at, clock = timestamp(), time.perf_counter()
        max_calls = self.calls_for(key.scene, key.budget)
        environment = child_environment(os.environ, self.scenes_dir)
        clean = Redaction.of(environment)
        async with (
            self.users.one() as user,
            watch_episode(laboratory, key.scene, key.seed, max_calls, guarded=self.guarded) as episode,
        ):
            prompt = f"{await episode.prompt(key)}\n\n{_rules(max_calls, self.max_wall_s)}"
            ended: Ended | None = None
            failure = ""
            try:
                ended = await _run(self, episode, prompt, environment, user)
            except AgentError as error:
                failure = str(error)
            turns = await episode.turns()
        found, answer = outcome_of(turns, max_calls)
        outcome = found or Outcome.AGENT_ERROR
        if outcome is Outcome.AGENT_ERROR and ended is not None:
            # Remove secrets before truncating: half a secret would not be recognised.
            failure = clean.text(_how_it_ended(self, ended, len(turns), max_calls))[:_FAILURE]
        output = clean.text(ended.stdout)[-_REASONING:].strip() if ended else ""
        return Episode(
            key=key,
            outcome=outcome,
            answer=answer,
            prompt=prompt,
            turns=_with_reasoning(turns, output),
            error=failure if outcome is Outcome.AGENT_ERROR else None,
            unsealed=self.unsealed,
            max_calls=max_calls,
            started_at=started_at,
            duration_s=time.perf_counter() - clock,
            versions=versions,
        )


def calls_allowed(scene: int, scenes_dir: Path | None) -> int | None:
    """The limit on calls that a scene states; None if it states none, or if `scenes_dir` does not contain its pack."""
    try:
        limits = read_public(find_pack(scene, scenes_dir)).limits
    except PackError:
        return None
    return None if limits is None else limits.calls


async def _run(
    agent: ExternalAgent,
    episode: WatchedEpisode,
    prompt: str,
    environment: Mapping[str, str],
    user: SystemUser | None,
) -> Ended:
    """Run the command in temporary folders until it exits, times out, or can make no further call."""

    async def nothing_more_to_do() -> None:
        if await episode.until_end():
            await anyio.sleep(agent.grace_s)

    with episode_folders(agent.home, user) as folders:
        folders.config.write_text(json.dumps(client_config(episode), indent=2) + "\n", encoding="utf-8")
        values = {"mcp_config": str(folders.config), "mcp_url": episode.mcp_url, "prompt": prompt}
        # Replace all placeholders in one pass, so that braces in the prompt are left alone.
        command = [_PLACEHOLDER.sub(lambda found: values[found[1]], word) for word in agent.command]
        address = {URL: episode.mcp_url} | ({TOKEN: episode.token} if episode.token else {})
        try:
            return await run_child(
                command,
                folders=folders,
                env={**environment, **address, **folders.variables()},
                stdin=None if any("{prompt}" in word for word in agent.command) else prompt,
                max_wall_s=agent.max_wall_s,
                until=nothing_more_to_do,
                user=user,
            )
        except OSError as error:
            raise AgentError(f"{agent.command[0]} cannot be started: {error.strerror or error}") from error


def client_config(episode: WatchedEpisode) -> dict[str, object]:
    """An MCP client configuration in the common `mcpServers` format, with the episode as its only server."""
    server: dict[str, object] = {"type": "http", "url": episode.mcp_url}
    if episode.token:
        server["headers"] = {"Authorization": f"Bearer {episode.token}"}
    return {"mcpServers": {"physment": server}}


def _rules(max_calls: int, max_wall_s: float) -> str:
    return (
        "# Budget\n\nThe laboratory is the MCP server `physment`. You may make"
        f" {max_calls} tool calls, refused ones included, within {max_wall_s:g} s of wall time. If you have not called"
        " `answer` by then, the task counts as failed."
    )


def _how_it_ended(agent: ExternalAgent, ended: Ended, calls: int, max_calls: int) -> str:
    """Explain in one sentence why a program ended without an answer although it had calls left."""
    program = Path(agent.command[0]).name
    if ended.out_of_time:
        return f"{program} gave no answer within {agent.max_wall_s:g} s and was stopped"
    errors = [line.strip() for line in ended.stderr.splitlines() if line.strip()]
    if ended.code:
        return f"{program} ended with code {ended.code}{f': {errors[-1]}' if errors else ''}"
    return f"{program} ended without an answer after {calls} of {max_calls} calls"


def _with_reasoning(turns: tuple[Turn, ...], output: str) -> tuple[Turn, ...]:
    """Attach the program's output to the last turn; if there were no calls, return one turn with the output."""
    if not output:
        return turns
    last = turns[-1] if turns else Turn(reasoning="")
    return (*turns[:-1], last.model_copy(update={"reasoning": output}))


def parse_external(
    words: Sequence[str],
    server: str,
    scenes_dir: Path | None,
    *,
    vouched: bool = False,
    users: Sequence[str] = (),
    max_calls: int | None = None,
    max_wall_s: float = 1800.0,
    home: Path | None = None,
    environ: Mapping[str, str] = os.environ,
) -> ExternalAgent:
    """Build the agent that `--agent external -- COMMAND` names.

    Args:
        words: The words of COMMAND.
        server: Value of `--server`.
        scenes_dir: Value of `--scenes-dir`.
        vouched: Whether the operator states that COMMAND cannot read any scene pack.
        users: System users that may run COMMAND.
        max_calls: Most tool calls in an episode; None for as many as the scene allows, or ten for each iteration.
        max_wall_s: Largest wall time of an episode [s].
        home: Template folder copied into each home folder of COMMAND.
        environ: Environment variables, which may hold a token for the server.

    Raises:
        UsageError: The command is missing, cannot be found, or has no way to learn the address of its episode.
    """
    _check_placeholders(words, sealed=vouched)
    if server != "host" and not server.startswith(("http://", "https://")):
        raise UsageError(NEEDS_ADDRESS)
    if home is not None and not home.is_dir():
        raise UsageError(f"--home-template {home}: there is no such folder")
    program = shutil.which(words[0])
    if program is None:
        raise UsageError(f"there is no program {words[0]!r}")
    for word in words[1:]:
        if not Path(word).is_absolute() and Path(word).is_file():
            raise UsageError(
                f"{word}: the command runs in an empty folder, so write the path in full: {Path(word).resolve()}"
            )
    return ExternalAgent(
        (str(Path(program).absolute()), *words[1:]),
        _why_unsealed(server, scenes_dir, guarded=TOKEN_VARIABLE in environ, vouched=vouched),
        max_calls,
        max_wall_s,
        scenes_dir=scenes_dir,
        home=home,
        guarded=vouched,
        users=SystemUsers(system_users(users)),
    )


def _check_placeholders(words: Sequence[str], *, sealed: bool) -> None:
    """Check that a command receives the address of its episode, and does not expose it to other users.

    Raises:
        UsageError: The command does not receive the address, or would expose it on its command line.
    """
    if not words:
        raise UsageError(
            "--agent external needs a command after --, such as: -- my-agent --mcp-config {mcp_config} --print {prompt}"
        )
    if sealed and any("{mcp_url}" in word for word in words):
        raise UsageError(
            "--sealed: {mcp_url} would stand in the command line, which every user of the machine can read; write"
            f" {{mcp_config}} (path of a client configuration), or let the program read {URL} and {TOKEN} from its"
            " environment"
        )
    if not any(place in word for word in words for place in ("{mcp_config}", "{mcp_url}", URL)):
        raise UsageError(
            f"the command {shlex.join(words)!r} could not find the laboratory: write {{mcp_config}} (path of a client"
            f" configuration) or {{mcp_url}} (address of the episode) where it takes one, or {URL} (environment"
            " variable with the address)"
        )


def _why_unsealed(server: str, scenes_dir: Path | None, *, guarded: bool, vouched: bool) -> str | None:
    """Explain why an external program could have information that its score should not depend on.

    Returns:
        A clause; None if no reason is known, or if the operator vouches for the isolation.
    """
    if server != "host" and not guarded:  # the host that we start ourselves always has a token
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
    if server == "host" or urlsplit(server).hostname in {"localhost", "127.0.0.1", "::1"}:
        return "the host of the laboratory is on the machine where it runs"
    return None
