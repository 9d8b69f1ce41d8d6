"""How hard each scene is and how able each agent, on one scale, with errors."""
