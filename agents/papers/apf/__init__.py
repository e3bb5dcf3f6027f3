"""The potential-field paper's results regenerated."""
