"""`tsuiseki simulate`: a file for each of its commands."""
