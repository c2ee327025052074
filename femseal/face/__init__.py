"""A face under its loads, cut into cells: the permeability of each, along any path of the pressure."""
