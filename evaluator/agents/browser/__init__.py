"""A person who plays in a browser: the agent, the state of the page, and the HTTP application that serves it."""
