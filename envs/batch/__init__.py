"""The batch behind a task: its memory, its bodies, its threads, and its state as one value."""
