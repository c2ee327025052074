"""Cut a surface in its contact states into cells, and compute the permeability of each cell for any load path."""
