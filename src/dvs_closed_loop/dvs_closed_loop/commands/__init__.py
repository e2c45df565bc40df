"""Subcommands of the console script `dvs_closed_loop`."""
