"""`tsuiseki evaluate`: a file for each of its commands."""
