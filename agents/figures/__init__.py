"""Pictures of episodes and training runs."""
