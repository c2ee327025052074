"""Refine the numerical settings of a case until its leakage has the required accuracy."""
