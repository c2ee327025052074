"""Surface in its contact states, cut into cells, and the permeability of each cell for any load path."""
