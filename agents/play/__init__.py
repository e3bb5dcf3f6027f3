"""`planarm play`: environments that run in real time, drawn and changed in a browser."""
