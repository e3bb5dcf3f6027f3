"""Shared by the planning methods: time laws, paths, motion along a line, rides with a target, space-time search."""
