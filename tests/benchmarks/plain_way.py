"""A seal study as one writes it with other programs: contact by Tamaas or ContactMechanics, flow by scikit-fem and pyamg.

Nothing of femseal is used here. Fields are samples at the nodes of a grid of square pixels, periodic along both axes,
(n1, n2). What is the same at all states, such as plans of transforms, meshes and bases, is made once.

What the other programs cannot do, and what is written here in their place or left out: neither keeps a history, so that
the plastic deformation of a peak is added to the gap by hand; neither has a face that is free along one axis and periodic
along the other, so that faces are periodic along both.
"""

from __future__ import annotations

import logging

import numpy as np

#: Unknowns up to which a general sparse factorisation takes less time than to set multigrid up.
DIRECT = 6000


class TamaasContact:
    """Saturated contact by Kato's algorithm; elastic contact by Polonsky and Keer's with Rey's preconditioning.

    Lengths are in sizes of the face and pressures in moduli: in SI units the algorithm for saturated contact does not
    return, because the loop in it that keeps the load compares with an absolute tolerance.
    """

    def __init__(self, shape, spacing, modulus, hardness, tolerance):
        import tamaas

        tamaas.set_log_level(tamaas.LogLevel.error)
        tamaas.initialize(1)
        self.size, self.modulus, self.hardness, self.tolerance = shape[0] * spacing, modulus, hardness, tolerance
        self.model = tamaas.Model(tamaas.model_type.basic_2d, [n / shape[0] for n in shape], list(shape))
        self.model.E, self.model.nu = 1.0, 0.0

    def __call__(self, gap0, pressure):
        """Pressure [Pa] and raw gap [m], which is negative where the material is at its hardness, under a mean pressure."""
        import tamaas

        heights = np.ascontiguousarray(gap0.mean() - gap0) / self.size
        self.model.traction[:], self.model.displacement[:] = pressure / self.modulus, 0.0
        if np.isinf(self.hardness):
            solver = tamaas.PolonskyKeerRey(self.model, heights, self.tolerance)
        else:
            solver = tamaas.KatoSaturated(self.model, heights, self.tolerance, self.hardness / self.modulus)
        solver.max_iter = 20000
        solver.solve(pressure / self.modulus)
        self.model.solveNeumann()  # the solver leaves displacements that touch at the hardness too
        p = np.array(self.model.traction) * self.modulus
        raw = np.array(self.model.displacement) * self.size + gap0
        return p, raw - touching_level(raw, p, self.hardness)


class ContactMechanicsContact:
    """Polonsky and Keer's constrained conjugate gradients, with a hardness.

    They start from the nominal pressure everywhere: from their own start they did not converge at light loads.
    """

    def __init__(self, shape, spacing, modulus, hardness, tolerance):
        from ContactMechanics import PeriodicFFTElasticHalfSpace

        self.sizes = tuple(n * spacing for n in shape)
        self.substrate = PeriodicFFTElasticHalfSpace(shape, modulus, self.sizes)
        self.pixel, self.hardness, self.tolerance = spacing**2, hardness, tolerance

    def __call__(self, gap0, pressure):
        """Pressure and raw gap, as those of `TamaasContact`."""
        from ContactMechanics.Optimization.ConstrainedConjugateGradients import constrained_conjugate_gradients
        from SurfaceTopography import Topography

        bound = {} if np.isinf(self.hardness) else {"hardness": self.hardness * self.pixel}
        highest = pressure if np.isinf(self.hardness) else self.hardness
        result = constrained_conjugate_gradients(
            self.substrate,
            Topography(gap0.max() - gap0, self.sizes),
            external_force=pressure * self.sizes[0] * self.sizes[1],
            pentol=self.tolerance * gap0.std(),
            forcetol=self.tolerance * highest * self.pixel,
            thermotol=self.tolerance,
            initial_forces=-self.start(gap0, pressure) * self.pixel,
            maxiter=5000,
            **bound,
        )
        if not result.success:
            raise RuntimeError(f"ContactMechanics: {result.message}")
        p = np.asarray(result.jac) / self.pixel
        raw = np.asarray(result.x) + gap0
        return p, raw - touching_level(raw, p, self.hardness)

    def start(self, gap0, pressure):
        """Pressure from which the solution starts [Pa]."""
        return np.full(gap0.shape, pressure)


class FromBearingArea(ContactMechanicsContact):
    """The same from a better start than its manual has: the hardness on the highest points that can carry the load."""

    def start(self, gap0, pressure):
        return np.where(gap0 <= np.quantile(gap0, pressure / self.hardness), self.hardness, 0.0)


CONTACTS = {
    "Tamaas": TamaasContact,
    "ContactMechanics": ContactMechanicsContact,
    "ContactMechanics from bearing area": FromBearingArea,
}


def touching_level(raw, p, hardness):
    """Mean of the gap where material touches below its hardness, where it is 0; else the level of the bearing area."""
    inside = (p > 0) & (p < hardness * (1 - 1e-9))
    return raw[inside].mean() if inside.any() else np.quantile(raw, np.mean(p > 0))


def gaps_of_cycle(contact, gap0, loading, unload_from, unloading):
    """Gaps along a load cycle: all loads, then the loads below each peak, on faces that the peak has deformed for good."""
    deformed, gaps = {}, []
    for pressure in loading:
        p, raw = contact(gap0, pressure)
        if pressure in unload_from:
            deformed[pressure] = gap0 + np.where(p > 0, np.maximum(-raw, 0), 0)
        gaps.append(np.maximum(raw, 0))
    for peak in unload_from:
        gaps += [np.maximum(contact(deformed[peak], stop)[1], 0) for stop in unloading if stop < peak]
    return gaps


class PlainFlow:
    """Permeability along x1 of cells of (n1, n2) square pixels by bilinear elements, periodic along x2 or closed there."""

    def __init__(self, shape, periodic, solver="pyamg", tolerance=1e-6):
        from skfem import Basis, BilinearForm, ElementQuad1, MeshQuad, MeshQuad1DG
        from skfem.helpers import dot, grad

        logging.getLogger("skfem").setLevel(logging.ERROR)

        @BilinearForm
        def reynolds(p, q, w):
            return w.h**3 / 12 * dot(grad(p), grad(q))

        n1, n2 = shape
        self.shape, self.form, self.solver, self.tolerance = shape, reynolds, solver, tolerance
        flat = MeshQuad.init_tensor(np.arange(n1 + 1.0), np.arange(n2 + 1.0))
        self.node = tuple(flat.p.astype(int))
        self.gap_basis = Basis(flat, ElementQuad1(), intorder=2)
        self.basis = self.gap_basis
        if periodic:
            last, first = (flat.nodes_satisfying(lambda x, at=at: x[1] == at) for at in (n2, 0))
            self.basis = Basis(MeshQuad1DG.periodic(flat, last, first), ElementQuad1(), intorder=2)
        x = self.basis.doflocs[0]
        self.inlet, self.outlet = x == 0, x == n1

    def __call__(self, gap):
        """Permeability of a gap at the nodes (n1 + 1, n2 + 1) in units of the gap's cube."""
        top = gap.max()
        if top == 0:
            return 0.0
        matrix = self.form.assemble(self.basis, h=self.gap_basis.interpolate(gap[self.node] / top))
        matrix.eliminate_zeros()
        conductance = drop_solved(matrix, self.inlet, self.outlet, self.solver, self.tolerance)
        return conductance * top**3 * self.shape[0] / self.shape[1]


def drop_solved(matrix, inlet, outlet, solver, tolerance=1e-6):
    """Flow for a unit drop between two sets of nodes, from the matrix of all nodes; 0 where nothing joins them."""
    from scipy.sparse.csgraph import connected_components

    count, cluster = connected_components(matrix, directed=False)
    through = np.zeros(count, bool)
    through[np.intersect1d(cluster[inlet], cluster[outlet])] = True
    unknown = np.flatnonzero(through[cluster] & ~inlet & ~outlet)
    p = (inlet & through[cluster]).astype(float)
    p[unknown] = sparse_solution(matrix[unknown][:, unknown], -(matrix @ p)[unknown], solver, tolerance)
    return float(p @ (matrix @ p))


def sparse_solution(a, b, solver, tolerance):
    """Solution by pyamg's Ruge–Stüben multigrid with conjugate gradients, by PARDISO, or by SuperLU where it is small."""
    if solver == "SuperLU" or b.size < DIRECT:
        from scipy.sparse.linalg import splu

        if b.size == 0:
            return b
        options = {"SymmetricMode": True}
        return splu(a.tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options).solve(b)
    if solver == "PARDISO":
        import pypardiso

        factors = pypardiso.PyPardisoSolver()
        x = pypardiso.spsolve(a.tocsr(), b, solver=factors)
        factors.free_memory(everything=True)
        return x
    import pyamg

    residuals = []
    hierarchy = pyamg.ruge_stuben_solver(a.tocsr())
    x = hierarchy.solve(b, tol=tolerance, accel="cg", maxiter=1000, residuals=residuals)
    if residuals[-1] > tolerance * np.linalg.norm(b):
        raise RuntimeError(
            f"pyamg: residual {residuals[-1] / np.linalg.norm(b):.1e} after {len(residuals) - 1} iterations"
        )
    return x


def closed_ring(gap):
    """Gap at the nodes of a periodic face with its first row and column repeated at the end."""
    return np.pad(gap, ((0, 1), (0, 1)), mode="wrap")


def network_permeability(k1, k2, solver="SuperLU"):
    """Permeability of a square grid, periodic along x2, from its links."""
    import scipy.sparse as sp

    m1, m2 = k1.shape
    node = np.arange((m1 + 1) * m2).reshape(m1 + 1, m2)
    tail = np.concatenate([node[:-1].ravel(), node[1:-1].ravel()])
    head = np.concatenate([node[1:].ravel(), np.roll(node, -1, axis=1)[1:-1].ravel()])
    k = np.concatenate([k1.ravel(), k2.ravel()])
    tail, head, k = tail[k > 0], head[k > 0], k[k > 0]
    graph = sp.coo_matrix((k, (tail, head)), (node.size, node.size)).tocsr()
    graph = graph + graph.T
    matrix = (sp.diags(np.asarray(graph.sum(axis=1)).ravel()) - graph).tocsr()
    inlet, outlet = np.arange(node.size) < m2, np.arange(node.size) >= m1 * m2
    return drop_solved(matrix, inlet, outlet, solver, 1e-8) * m1 / m2
