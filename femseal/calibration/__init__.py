"""Calibration: hardness, shortest wave and a factor between model and test, from a measured curve of leakage."""

from ..base.lazy_package import lazy

__getattr__, __dir__ = lazy(__name__)
