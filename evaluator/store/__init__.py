"""A run folder: files that survive a kill, their checksums, and what is taken out of them."""
