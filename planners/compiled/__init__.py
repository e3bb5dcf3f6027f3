"""How compiled functions are compiled and called."""
