"""Programs that play by MCP themselves, watched from outside."""
