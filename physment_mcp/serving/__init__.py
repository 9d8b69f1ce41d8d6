"""What speaks MCP: the server, its resources and prompts, and the host of many episodes."""
