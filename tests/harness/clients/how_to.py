"""Generates the page on clients from the programs that `python -m tests.harness.clients.run` runs."""

from collections.abc import Sequence
from pathlib import Path

from tests.harness.clients.catalogue import Client, read_clients

PAGE = Path(__file__).parents[3] / "docs" / "how-to" / "clients.md"

_OPENING = """\
# How to connect a client

Made from the programs in `tests/harness/clients/programs` by `pytest tests/harness/clients --update-goldens`; do not
edit. `python -m tests.harness.clients.run` plays a whole episode with each of them, in a separate environment; [the
results](../reference/clients.md).

Each program takes two arguments: where the laboratory is, and the opening prompt. The first is the address of an
episode, or a command that starts a laboratory:

```sh
python agent.py http://127.0.0.1:8000/episodes/…/mcp "$PROMPT"    # an episode on a host: physment-mcp serve
python agent.py "physment-mcp --scene 7" "$PROMPT"                # its own laboratory, on stdio
```

To have the episode graded, let the evaluator open it and fill in both arguments ([more](external-agents.md)). Use
absolute paths, because the program runs in an empty folder:

```sh
physment-eval run --agent external --server host --scenes 20,23 -- python "$PWD/agent.py" {mcp_url} {prompt}
```

Models and keys are those of the vendors: set `OPENAI_API_KEY`, and `OPENAI_BASE_URL` for another server with the same
protocol; for ADK, `GOOGLE_API_KEY`; for Claude Code, `ANTHROPIC_API_KEY`. Run a program in `.sh` with `sh`.

## For all clients

- **One call at a time.** Most frameworks run the calls of one reply in parallel. The laboratory runs them one at a
  time, but in an unpredictable order: `step` may run before the push. Disable parallel calls if possible.
- **A host for clients that reconnect.** On stdio a process is an episode. A client that starts a process for each call
  gets a new laboratory every time. Over HTTP the address is the episode, however often the client connects.
- **Refusals are results.** A refused call returns one sentence that says why, marked as an error. An agent learns from
  it, so the run must continue.
- **Time.** A call of `step` may take longer than the default timeout of some clients, a few seconds.
"""


def page(clients: Sequence[Client]) -> str:
    """The text of the page."""
    return _OPENING + "".join(_section(client) for client in clients)


def _section(client: Client) -> str:
    installed = f"pip install {' '.join(map(_quoted, client.requirements))}"
    if client.npm:
        installed = f"npm install --global {' '.join(client.npm)}"
    kind = "python" if client.program.endswith(".py") else "sh"
    program = f"```{kind} file={client.program}\n{client.source}```"
    return f"\n## {client.name}\n\n{client.know}\n\n```sh\n{installed}\n```\n\n{program}\n"


def _quoted(requirement: str) -> str:
    return f'"{requirement}"' if "[" in requirement else requirement


def current() -> str:
    """Return the text of the page, generated from the current programs."""
    return page(read_clients())
