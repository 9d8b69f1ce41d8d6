"""Why an episode may have gone wrong: six rules over a recorded episode, each with its evidence."""
