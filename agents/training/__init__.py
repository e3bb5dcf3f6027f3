"""PPO on planarm's vector environments: configuration, run folders, resuming; needs the `rl` extra."""
