"""The third-party clients that are tested, read from `clients.toml`."""

import tomllib
from pathlib import Path
from typing import Literal

from pydantic import BaseModel, ConfigDict, TypeAdapter

HERE = Path(__file__).parent
PROGRAMS = HERE / "programs"


class Client(BaseModel):
    """A third-party client: its packages, how it uses stdio, and notes for its users."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    name: str
    package: str
    """Package whose version is reported; an npm package has the prefix `npm:`."""
    program: str
    """File in `programs`; its arguments are the address of the laboratory and the opening prompt."""
    requirements: tuple[str, ...]
    npm: tuple[str, ...] = ()
    scenes: tuple[int, ...] = (20, 23)
    """Scenes to play: scene 20 needs a created object, scene 23 a found object."""
    stdio: Literal["session", "process-per-call", "none"] = "session"
    """How the client uses stdio: one server process per episode, one per call, or not at all."""
    know: str

    @property
    def source(self) -> str:
        """The source code of the program, which is run and shown on the page."""
        return (PROGRAMS / self.program).read_text(encoding="utf-8")


def read_clients() -> tuple[Client, ...]:
    """All clients, in the order of the table."""
    raw = tomllib.loads((HERE / "clients.toml").read_text(encoding="utf-8"))
    return TypeAdapter(tuple[Client, ...]).validate_python(raw["client"])
