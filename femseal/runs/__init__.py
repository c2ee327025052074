"""Run a case: forecast time and memory, solve the studies, and write the results folder."""
