"""Calibrate hardness, shortest wave and a factor between test and model with a measured leakage curve."""

from ..base.lazy_package import lazy

__getattr__, __dir__ = lazy(__name__)
