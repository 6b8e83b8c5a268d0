"""`tsuiseki track`: a file for each of its commands."""
