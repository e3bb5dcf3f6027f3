"""The conveyor-tracking paper's results regenerated."""
