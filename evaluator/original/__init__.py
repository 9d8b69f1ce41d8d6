"""The published logs of the paper's runs: replays them on this project's server, and compares the verdicts."""
