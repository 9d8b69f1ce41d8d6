"""The application: `server --port 8000`, or uvicorn with `server.app:app`."""

import argparse
import os

import uvicorn
from physment_openenv.models import PhysmentAction, PhysmentObservation, PhysmentState
from physment_openenv.server.environment import PhysmentEnvironment

from openenv.core.env_server.http_server import create_app

SESSIONS_VARIABLE = "PHYSMENT_OPENENV_SESSIONS"
"""Environment variable with the largest number of simultaneous sessions."""

app = create_app(
    PhysmentEnvironment,
    PhysmentAction,
    PhysmentObservation,
    env_name="physment_openenv",
    max_concurrent_envs=int(os.environ.get(SESSIONS_VARIABLE) or 64),
    state_cls=PhysmentState,
)


def main() -> None:
    """Serve until interrupted."""
    parser = argparse.ArgumentParser(description="Serve PhysMent's laboratory to OpenEnv clients.")
    parser.add_argument("--host", default="127.0.0.1", help="address to listen on (default %(default)s)")
    parser.add_argument("--port", type=int, default=8000, help="port (default %(default)s)")
    args = parser.parse_args()
    uvicorn.run(app, host=args.host, port=args.port, log_level="warning")


if __name__ == "__main__":
    main()
