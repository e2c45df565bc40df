"""Subcommands of the console script `dvs_simulation`."""
