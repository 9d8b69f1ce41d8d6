#!/bin/sh
# The laboratory of this task: one episode, open from the start at /episodes/0/mcp. No other can be opened, and its log
# cannot be read, without the token, which is made here and never leaves this container.
set -eu
here=$(dirname "$0")
umask 077
python3 -c 'import secrets; print(secrets.token_urlsafe(24))' > "$here/token"
exec physment-mcp serve --host 0.0.0.0 --port "${PHYSMENT_PORT:-8000}" --allow-host laboratory --token-stdin \
  --idle-timeout 86400 --scenes-dir "$here/scenes" --open "$(cat "$here/episode.json")" < "$here/token"
