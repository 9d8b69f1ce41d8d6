#!/bin/sh
# Grades the log that the laboratory kept. Runs in a container of its own, which no agent has been in.
set -eu
logs=${VERIFIER_LOGS:-/logs/verifier}
physment-eval harbor grade "${EVIDENCE:-/laboratory/calls.json}" --episode "$(dirname "$0")/episode.json" > "$logs/rewards.tmp"
mv "$logs/rewards.tmp" "$logs/reward.json"
cat "$logs/reward.json"
