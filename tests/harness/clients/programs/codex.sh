#!/bin/sh
# Plays an episode with Codex CLI, without its shell.
laboratory=$1 task=$2
case $laboratory in
  http*) server="url=\"$laboratory\"" ;;
  *) server="command=\"sh\", args=[\"-c\", \"exec $laboratory\"]" ;;
esac
provider="name=\"server\", base_url=\"${OPENAI_BASE_URL:-https://api.openai.com/v1}\", env_key=\"OPENAI_API_KEY\""
# Otherwise it asks before it calls `answer`, and nobody is here. A call of `step` may take longer than the usual timeout.
server="$server, default_tools_approval_mode=\"approve\", tool_timeout_sec=300"
exec codex exec --skip-git-repo-check --sandbox read-only --disable shell_tool --model gpt-5.5 \
  -c model_provider=server -c "model_providers.server={$provider}" -c "mcp_servers.physment={$server}" "$task" </dev/null
