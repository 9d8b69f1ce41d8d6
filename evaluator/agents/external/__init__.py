"""External agents: programs that connect to an episode over MCP themselves; the evaluator only observes them."""
