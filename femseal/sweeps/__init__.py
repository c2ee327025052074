"""Run a case with several values of some of its keys, and compare the runs."""
