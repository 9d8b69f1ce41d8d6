#!/bin/sh
# Makes the calls by which the reference protocol solved this variant. The same calls have the same returns.
set -eu
here=$(dirname "$0")
exec python3 "$here/play.py" "${PHYSMENT_MCP_URL:-http://laboratory:8000/episodes/0/mcp}" "$here/calls.json"
