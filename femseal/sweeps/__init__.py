"""Run a case with several values of some keys of the case file, and compare the runs."""
