#!/bin/sh
# Scene 23 by hand, with the command line of the MCP Inspector. Each command is a connection of its own.
laboratory=$1

call() {
  mcp-inspector --cli "$laboratory" --transport http --method tools/call --tool-name "$@"
}

# What is refused says why, and ends with a code of its own.
for attempt in first second third; do
  call get_position --tool-arg object_id=object_99 || echo "$attempt refusal, code $?"
done
call find_objects
call apply_force --tool-arg object_id=object_2 'force_vector=[0, 0, -20]'
call step --tool-arg duration=15
moved=$(call get_displacement --tool-arg object_id=object_2)
call answer --tool-arg "answer=$(node -p '20 / JSON.parse(process.argv[1]).structuredContent.displacement' "$moved")"
