"""Which third-party clients there are, as `clients.toml` has it."""

import tomllib
from pathlib import Path
from typing import Literal

from pydantic import BaseModel, ConfigDict, TypeAdapter

HERE = Path(__file__).parent
PROGRAMS = HERE / "programs"


class Client(BaseModel):
    """A client, what is installed for it, and what its user must know."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    name: str
    package: str
    """Whose version is told; `npm:` and a name for one of npm."""
    program: str
    """File in `programs`; takes the place of the laboratory and the opening prompt."""
    requirements: tuple[str, ...]
    npm: tuple[str, ...] = ()
    scenes: tuple[int, ...] = (20, 23)
    """Scene 20 wants a created object, scene 23 a found one."""
    stdio: Literal["session", "process-per-call", "none"] = "session"
    """How it uses a laboratory on stdio: one process for an episode, one for each call, or not at all."""
    know: str

    @property
    def source(self) -> str:
        """The program, as it is run and shown."""
        return (PROGRAMS / self.program).read_text(encoding="utf-8")


def read_clients() -> tuple[Client, ...]:
    """All clients, in the order of the table."""
    raw = tomllib.loads((HERE / "clients.toml").read_text(encoding="utf-8"))
    return TypeAdapter(tuple[Client, ...]).validate_python(raw["client"])
