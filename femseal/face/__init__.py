"""Cut a surface into cells, and compute the permeability of each cell in the contact states of any load path."""
