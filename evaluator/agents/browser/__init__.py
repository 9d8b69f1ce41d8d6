"""A person in a browser as an agent: what the page shows, and how its turns reach the loop."""
