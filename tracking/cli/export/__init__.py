"""`tsuiseki export`: a file for each of its commands."""
