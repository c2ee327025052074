"""Define what all seals on a mesh have in common."""

import numpy as np
from skfem import Mesh

from ..base import Array


class SealOnMesh:
    """Give the shapes of the arrays of a seal whose permeability is constant on each element of its `mesh`."""

    mesh: Mesh

    @property
    def element_shapes(self) -> tuple[tuple[int, ...], ...]:
        """Allowed shapes of a permeability array that does not contain tensors."""
        return (self.mesh.nelements,), (self.mesh.nelements, 2)

    def corner_values(self, values: Array) -> Array:
        """Return values at the corners of each element (n, corners) from values at the vertices (n_vertices,)."""
        return np.asarray(values[self.mesh.t.T])
