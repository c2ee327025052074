"""How finely the sides of window elements are resolved."""

#: Largest distance of two nodes on a side, in pixels.
NODE_SPACING = 8
