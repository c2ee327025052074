"""A face under its loads, cut into pieces: the permeability of each, along any path of the pressure."""

from ..base.lazy_package import load_when_used

load_when_used(__name__)
