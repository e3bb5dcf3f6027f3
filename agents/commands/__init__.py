"""The subcommands of `planarm`."""
