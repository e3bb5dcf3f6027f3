"""What a run does before its algorithm: DAgger and amortised optimisation, with their own checkpoints."""
