"""A face under its loads, cut into pieces: the permeability of each, along any path of the pressure."""

from ..base.lazy_package import lazy

__getattr__, __dir__ = lazy(__name__)
