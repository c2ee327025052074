"""A face under its loads, cut into pieces: the permeability of each, along any path of the pressure."""
