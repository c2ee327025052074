"""Calibration: hardness, shortest wave and a factor between model and test, from a measured curve of leakage."""

from ..base.lazy_package import load_when_used

load_when_used(__name__)
