#!/bin/sh
# Plays an episode with Claude Code, which gets the tools of the laboratory and no others.
laboratory=$1 task=$2
case $laboratory in
  http*) server="{\"type\": \"http\", \"url\": \"$laboratory\"}" ;;
  *) server="{\"command\": \"sh\", \"args\": [\"-c\", \"exec $laboratory\"]}" ;;
esac
# Otherwise the tools of servers are not listed, and the model must search for them first.
export ENABLE_TOOL_SEARCH=false
exec claude --print "$task" --model claude-opus-4-7 --max-turns 200 --tools "" --allowedTools mcp__physment \
  --strict-mcp-config --mcp-config "{\"mcpServers\": {\"physment\": $server}}"
