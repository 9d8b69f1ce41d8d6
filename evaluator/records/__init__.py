"""What is recorded of episodes and runs, as frozen records, and the key of held-back seeds."""
