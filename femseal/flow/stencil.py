"""The operator of a structured grid of nodes, as the conductances of every node with its neighbours."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike, NDArray

from ..base import Array, InputError
from ..base.compiled import compiled
from ..base.threads import over, rows


@dataclass(frozen=True)
class Stencil:
    """Conductances of neighbouring nodes: minus the entries of a symmetric matrix with zero row sums, in any one unit.

    A conductance c > 0 is that of a link between two nodes, so that a stencil, of five points, is a network of links.

    along (n1, n2) : nodes (i, j) and (i + 1, j) of n1 + 1 rows. Row 0 is the inlet, row n1 the outlet; in a `ring1`
        the rows form a ring, row n1 being row 0.
    across (n1 − 1, m2) : nodes (i, j) and (i, j + 1) of rows 1 … n1 − 1 (in a `ring1` of all n1 rows); m2 is n2 if the
        columns form a ring (`ring2`), else n2 − 1. Nodes of one end have one pressure: their conductances drop out.
    """

    along: Array
    across: Array
    ring2: bool = True
    ring1: bool = False

    @classmethod
    def network(cls, along: ArrayLike, across: ArrayLike, *, ring: bool = True) -> Stencil:
        """A network of links of given conductances, checked.

        along (n1, n2), across (n1 − 1, n2) : conductances >= 0; across has n2 − 1 columns if these form no `ring`.

        Raises InputError: shapes that do not match, conductances that are negative or not finite.
        """
        try:
            if np.iscomplexobj(along) or np.iscomplexobj(across):
                raise TypeError
            c1, c2 = (np.ascontiguousarray(c, dtype=float) for c in (along, across))
        except (TypeError, ValueError):
            raise InputError(
                "along, across",
                "no arrays of real numbers",
                "arrays of shapes (n1, n2) and (n1 - 1, n2)",
            ) from None
        if c1.ndim != 2 or c1.size == 0:
            raise InputError("along", f"shape {c1.shape}", "a shape (n1, n2)")
        expected = (c1.shape[0] - 1, c1.shape[1] - (not ring))
        if c2.shape != expected:
            raise InputError("across", f"shape {c2.shape}", f"shape {expected}")
        for name, c in (("along", c1), ("across", c2)):
            if not (np.isfinite(c).all() and c.min(initial=0.0) >= 0):
                raise InputError(name, "negative or undefined values", "finite conductances >= 0")
        if ring and c1.shape[1] == 1:  # the only node of a row is not its own neighbour
            c2 = np.zeros_like(c2)
        return cls(c1, c2, ring2=ring)

    @property
    def nodes(self) -> tuple[int, int]:
        """Rows and columns of nodes, the ends among the rows."""
        n1, n2 = self.along.shape
        return (n1 if self.ring1 else n1 + 1), n2

    def conductances(
        self,
    ) -> Iterator[tuple[Array, NDArray[np.int64], NDArray[np.int64], tuple[int, int]]]:
        """Arrays of conductances, numbers (row · n2 + column) of their two nodes, and steps from one to the other."""
        rows, n2 = self.nodes
        node = np.arange(rows * n2).reshape(rows, n2)
        below = np.roll(node, -1, axis=0) if self.ring1 else node[1:]
        here = node if self.ring1 else node[:-1]
        inner = node if self.ring1 else node[1:-1]
        m2 = self.across.shape[1]

        yield self.along, here, below, (1, 0)
        yield self.across, inner[:, :m2], np.roll(inner, -1, axis=1)[:, :m2], (0, 1)

    def energy(self, pressure: Array) -> float:
        """Σ c (Δp)² over all conductances for a pressure at the nodes, from differences, so that nothing cancels.

        Rows must not form a ring.
        """
        return float(
            sum(over(rows(*self.along.shape), energy_of, self.along, self.across, pressure))
        )

    def dissipation(self, potential: Array) -> tuple[Array, Array]:
        """Dissipation c (Δφ)² of the conductances along both axes .

        `potential` (n1 + 1, n2) is NaN in pockets, where nothing flows.
        """
        φ = np.nan_to_num(potential)
        across = (np.roll(φ, -1, axis=1) - φ)[1:-1, : self.across.shape[1]]
        return self.along * np.diff(φ, axis=0) ** 2, self.across * across**2

    def to_csr(self) -> sp.csr_array:
        """The matrix of all nodes, those of the ends among them; conductances between nodes of one end are left out."""
        rows, n2 = self.nodes
        size = rows * n2
        parts = [(c.ravel(), a.ravel(), b.ravel()) for c, a, b, _ in self.conductances()]
        c, a, b = (np.concatenate(part) for part in zip(*parts, strict=True))
        chosen = (c != 0) & (a != b)
        c, a, b = c[chosen], a[chosen], b[chosen]
        entries = np.concatenate([-c, -c, c, c])
        i, j = np.concatenate([a, b, a, b]), np.concatenate([b, a, a, b])
        return sp.coo_array((entries, (i, j)), shape=(size, size)).tocsr()


@compiled()
def energy_of(begin, end, along, across, p):
    """`Stencil.energy` of a pressure p, of some rows of conductances."""
    n2 = along.shape[1]
    m2 = across.shape[1]
    total = 0.0
    for i in range(begin, end):
        here, below = p[i], p[i + 1]
        of_row = 0.0
        for j in range(n2):
            of_row += along[i, j] * (here[j] - below[j]) ** 2
        total += of_row
    for i in range(begin, min(end, across.shape[0])):
        here = p[i + 1]
        of_row = 0.0
        for j in range(n2 - 1):
            of_row += across[i, j] * (here[j] - here[j + 1]) ** 2
        if m2 == n2:
            of_row += across[i, n2 - 1] * (here[n2 - 1] - here[0]) ** 2
        total += of_row
    return total
