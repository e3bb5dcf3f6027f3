"""Parts of the campaign of random planning problems, `tools.fuzz_planners`."""
