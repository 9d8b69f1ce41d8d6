"""Films of stored episodes: played again to the last bit, with what could be seen, in small files for the report."""
