"""Damaged and hostile files for everything that planarm reads as data; see `tools.fuzz_files.__main__`."""
