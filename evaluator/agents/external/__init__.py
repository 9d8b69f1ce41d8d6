"""External agents: programs that play over MCP by themselves and are watched from outside."""
