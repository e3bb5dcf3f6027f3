"""What the planning methods share: time laws, paths, stages, rides with a moving target, and a search in space and time."""
