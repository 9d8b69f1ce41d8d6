"""A run in the browser while it is played. Reads its folder, and changes nothing there."""
