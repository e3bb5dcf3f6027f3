"""The physics: the compiled bridge to Chipmunk, arms as rigid bodies, and actuation."""
