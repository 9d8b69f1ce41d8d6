"""Parses `--agent external -- COMMAND`, and decides whether the program could read the answers."""

import os
import shlex
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from urllib.parse import urlsplit

from evaluator.agents.external.agent import NEEDS_ADDRESS, ExternalAgent
from evaluator.agents.external.isolation import TOKEN, URL, SystemUsers, system_users
from evaluator.episode.hosts import TOKEN_VARIABLE
from evaluator.errors import UsageError
from scenes import PackError, default_folder, list_packs

_LOCAL = {"localhost", "127.0.0.1", "::1"}


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
    if server == "host" or urlsplit(server).hostname in _LOCAL:
        return "the host of the laboratory is on the machine where it runs"
    return None
