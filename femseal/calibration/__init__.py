"""Calibrate the hardness, the shortest wave and the leakage of a case with a leak test."""

from ..base.lazy_package import lazy

__getattr__, __dir__ = lazy(__name__)
