"""The MCP part: the server of an episode, its resources and prompts, and the host of many episodes."""
