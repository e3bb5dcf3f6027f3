"""Pictures of results: charts of the page, and figures for papers."""
