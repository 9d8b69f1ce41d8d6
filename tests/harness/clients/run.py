"""Runs every third-party client against the laboratory and prints the results.

python -m tests.harness.clients.run [NAME...] [--out FILE]    all clients, or those whose names contain one of the words

If names are given, the rows of other clients in FILE stay unchanged.
"""

import argparse
import re
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import anyio
from rich.console import Console
from rich.table import Table

from evaluator.commands.base import wide_console
from evaluator.report.export import markdown_table
from tests.harness.clients.catalogue import Client, read_clients
from tests.harness.clients.coding_agents import ROUTES
from tests.harness.clients.environments import CannotInstall, Environment, environment_of
from tests.harness.clients.playing import Played, difference, on_stdio, over_http, rehearse
from tests.harness.clients.scripted_model import app, serving


@dataclass(frozen=True, slots=True)
class Row:
    """The result of one client over one transport."""

    client: str
    version: str
    transport: str
    protocol: str
    works: bool
    why: str
    """Why the client does not work, or a note if it does."""
    know: str


TITLES = ("client", "version", "transport", "MCP protocol", "works", "what its user must know")


def rows_of(client: Client, expected: Mapping[int, Played], provider: str) -> list[Row]:
    """Run a client over all its transports."""
    try:
        environment = environment_of(client)
        version = environment.version(client.package)
    except CannotInstall as error:
        return [Row(client.name, "–", "–", "–", False, f"cannot be installed: {error}", client.know)]
    found = over_http(environment.command(client), client.scenes, provider, environment.path)
    rows = [_row(client, version, "HTTP", found, expected)]
    if client.stdio != "none":
        rows.append(_on_stdio(client, environment, version, expected, provider))
    return rows


def _on_stdio(
    client: Client, environment: Environment, version: str, expected: Mapping[int, Played], provider: str
) -> Row:
    found = {
        scene: on_stdio(environment.command(client), scene, expected[scene].prompt, provider, environment.path)
        for scene in client.scenes
    }
    if client.stdio == "session":
        return _row(client, version, "stdio", found, expected)
    # If the client now keeps one process, clients.toml is out of date.
    many = all(played.processes > 1 for played in found.values())
    why = (
        "no episode: it starts a process for each call" if many else "it keeps one process now: say so in clients.toml"
    )
    return Row(client.name, version, "stdio", _protocols(found), many, why, client.know)


def _row(
    client: Client, version: str, transport: str, found: Mapping[int, Played], expected: Mapping[int, Played]
) -> Row:
    problems = [
        f"scene {scene}: {problem}"
        for scene in client.scenes
        if (problem := difference(found[scene], expected[scene]) if scene in found else "not played")
    ]
    return Row(client.name, version, transport, _protocols(found), not problems, "; ".join(problems), client.know)


def _protocols(found: Mapping[int, Played]) -> str:
    return ", ".join(sorted({version for played in found.values() for version in played.protocols})) or "–"


def cells(row: Row) -> tuple[str, ...]:
    """The cells of a row of the table."""
    works = ("host only" if row.why else "yes") if row.works else "NO"
    note = row.why if row.why and not row.works else row.know
    return row.client, row.version, row.transport, row.protocol, works, note


def lines_of(rows: Sequence[Row]) -> list[tuple[str, ...]]:
    """The rows of the table; the note of a client is written only once."""
    lines: list[tuple[str, ...]] = []
    known = ""
    for row in rows:
        *facts, note = cells(row)
        lines.append((*facts, "as above" if note == known else note))
        known = note
    return lines


def kept_lines(file: Path, rows: Sequence[Row]) -> list[tuple[str, ...]]:
    """Return the table of a file, in which these rows replace the old rows of the same clients.

    Args:
        file: The page of an earlier run.
        rows: The rows of the clients that were run now.
    """
    found: dict[str, list[tuple[str, ...]]] = {}
    for line in file.read_text(encoding="utf-8").splitlines():
        if line.startswith("| ") and not line.startswith(f"| {TITLES[0]} |"):
            parts = tuple(part.replace("\\|", "|") for part in re.split(r" (?<!\\)\| ", line.strip("| ")))
            found.setdefault(parts[0], []).append(parts)
    for name in {row.client: row for row in rows}:
        found[name] = lines_of([row for row in rows if row.client == name])
    return [line for client in read_clients() for line in found.get(client.name, [])]


def page(table: Sequence[tuple[str, ...]]) -> str:
    """A table as a document."""
    lines = [
        "# Clients that were run",
        "",
        "Made by `python -m tests.harness.clients.run`; do not edit. Each client plays in a separate environment with a"
        " scripted model that"
        " makes three refused calls, then finds or creates an object, measures and answers. *Works* means that the"
        " calls, the results and the grade are the same as with the evaluator's own client. *Host only* means that the"
        " client starts a new stdio server for each call, so it can play an episode only on a host. Each row shows the"
        " latest run of that client."
        " [How to set each of them up](../how-to/clients.md).",
        "",
        markdown_table(TITLES, table),
    ]
    return "\n".join(lines) + "\n"


def main(argv: Sequence[str]) -> int:
    """Run the clients and print the table; returns 0 if all of them work."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", metavar="NAME")
    parser.add_argument("--out", type=Path, help="write the table there, if all clients that were run work")
    args = parser.parse_args(argv)
    console = Console(stderr=True)
    wanted = [
        client
        for client in read_clients()
        if not args.names or any(name.lower() in client.name.lower() for name in args.names)
    ]

    async def expectations() -> dict[int, Played]:
        scenes = sorted({scene for client in wanted for scene in client.scenes})
        return {scene: await rehearse(scene) for scene in scenes}

    expected = anyio.run(expectations)
    rows: list[Row] = []
    with serving(app(*ROUTES)) as provider:
        for client in wanted:
            with console.status(client.name):
                rows += rows_of(client, expected, provider)
            done = [f"{row.transport}: {cells(row)[4]}" for row in rows if row.client == client.name]
            console.print(f"{client.name}: {', '.join(done)}")
    table = Table(*TITLES, show_lines=True)
    for line in lines_of(rows):
        table.add_row(*line)
    wide_console().print(table)
    working = all(row.works for row in rows)
    if args.out and working and rows:
        lines = kept_lines(args.out, rows) if args.names and args.out.exists() else lines_of(rows)
        args.out.write_text(page(lines), encoding="utf-8")
    return 0 if working and rows else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
