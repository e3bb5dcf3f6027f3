"""What the planning methods share: time laws, paths, stages, rides with a moving target, space-time search."""
