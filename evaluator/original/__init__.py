"""The published logs of the paper's runs: replays them on our server, and compares their verdicts with ours."""
