"""`tsuiseki calibrate`: a file for each of its commands."""
