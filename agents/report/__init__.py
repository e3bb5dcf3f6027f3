"""The report of a benchmark: one HTML file, and its charts as figures for papers."""
