"""The published logs of the paper's runs: played again in our laboratory, their verdicts held against ours."""
