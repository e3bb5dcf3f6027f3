"""Policies: looked up by name or path, loaded, and the trained ones that ship with planarm."""
