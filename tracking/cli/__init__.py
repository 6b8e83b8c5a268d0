"""The command line, `tsuiseki`."""
