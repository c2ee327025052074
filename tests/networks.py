"""Networks of links for tests: the flow through given conductances, and the conductances of a cell."""

import numpy as np

from femseal.flow import Stencil, solve_flow
from femseal.flow.edge_flow import cell_stencil
from femseal.flow.grid import Grid


def network(c1, c2):
    """Stencil of links c1 (n1, n2) and c2 with n2 columns in a ring, n2 − 1 otherwise."""
    return Stencil.network(c1, c2, ring=np.shape(c2)[-1:] == np.shape(c1)[-1:])


def solve_links(c1, c2, **options):
    """Flow through the network of these links."""
    return solve_flow(network(c1, c2), **options)


def cell_links(gap, spacing, sides):
    """Conductances of the links between the pixels of a cell."""
    stencil = cell_stencil(gap, Grid.of_pixel_centres(gap.shape, spacing, sides))
    return stencil.along, stencil.across
