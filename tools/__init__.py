"""What only a maintainer runs: searches, tables, releases. Not part of the installed package."""
