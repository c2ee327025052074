"""Sweeps: a case run with several values of some of its keys, and the runs side by side."""
