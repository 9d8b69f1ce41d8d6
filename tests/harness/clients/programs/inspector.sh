#!/bin/sh
# Plays scene 23 with the command line of the MCP Inspector. Each command opens a new connection.
laboratory=$1

call() {
  mcp-inspector --cli "$laboratory" --transport http --method tools/call --tool-name "$@"
}

# A refused call says why, and ends with a non-zero exit code.
for attempt in first second third; do
  call get_position --tool-arg object_id=object_99 || echo "$attempt refusal, code $?"
done
call find_objects
call apply_force --tool-arg object_id=object_2 'force_vector=[0, 0, -20]'
call step --tool-arg duration=15
moved=$(call get_displacement --tool-arg object_id=object_2)
call answer --tool-arg "answer=$(node -p '20 / JSON.parse(process.argv[1]).structuredContent.displacement' "$moved")"
