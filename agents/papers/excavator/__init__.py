"""The excavator paper's results regenerated."""
