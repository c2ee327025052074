"""Run a case with several values of some case keys, and compare the runs."""
