"""The page on clients, made from the very programs that `make clients` runs."""

from collections.abc import Sequence
from pathlib import Path

from catalogue import Client, read_clients

PAGE = Path(__file__).parents[2] / "docs" / "how-to" / "clients.md"

_OPENING = """\
# How to connect a client

Made from the programs in `tests/clients/programs` by `pytest tests/clients --update-goldens`; do not edit. `make
clients` runs each of them, in an environment of its own, through a whole episode; [what came of
it](../reference/clients.md).

Each program takes two words: where the laboratory is, and the opening prompt. The first is the address of an episode,
or the command of a laboratory to start:

```sh
python agent.py http://127.0.0.1:8000/episodes/…/mcp "$PROMPT"    # an episode on a host: physment-mcp serve
python agent.py "physment-mcp --scene 7" "$PROMPT"                # a laboratory of its own, on stdio
```

To have it graded, let the evaluator open the episodes and fill in both
([more](external-agents.md); paths in full, as it runs in an empty folder):

```sh
physment-eval run --agent external --server host --scenes 20,23 -- python "$PWD/agent.py" {mcp_url} {prompt}
```

The models and keys are the vendors' own: `OPENAI_API_KEY`, and `OPENAI_BASE_URL` for a server that speaks the same
protocol; `GOOGLE_API_KEY` for ADK.

## What holds for all of them

- **One call at a time.** Most frameworks run the calls of one reply side by side. The laboratory takes them one after
  the other, but in an order that is anybody's guess: `step` may come before the push. Forbid parallel calls where you
  can.
- **A host for clients that reconnect.** On stdio a process is an episode. A client that starts one for each call finds
  every time a fresh laboratory. Over HTTP the address is the episode, however often the client connects.
- **Refusals are results.** A call that cannot be done returns one sentence that says why, marked as an error. An agent
  learns from it, so the run must go on.
- **Time.** A call of `step` may take longer than the few seconds that some clients wait.
"""


def page(clients: Sequence[Client]) -> str:
    """The whole page."""
    return _OPENING + "".join(_section(client) for client in clients)


def _section(client: Client) -> str:
    installed = f"pip install {' '.join(_quoted(one) for one in client.requirements)}"
    if client.npm:
        installed = f"npm install --global {' '.join(client.npm)}"
    kind = "python" if client.program.endswith(".py") else "sh"
    program = f"```{kind} file={client.program}\n{client.source}```"
    return f"\n## {client.name}\n\n{client.know}\n\n```sh\n{installed}\n```\n\n{program}\n"


def _quoted(requirement: str) -> str:
    return f'"{requirement}"' if "[" in requirement else requirement


def current() -> str:
    """The page as it should be."""
    return page(read_clients())
