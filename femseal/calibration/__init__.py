"""Calibration: hardness, shortest wave and a factor between model and test, from a measured curve of leakage."""
