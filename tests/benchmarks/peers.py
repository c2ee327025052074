"""Solve contact and flow with other programs, as a script would; femseal is not used in this module.

Contact is solved by Tamaas, ContactMechanics or ASPHER. The flow through a surface is solved by scikit-fem with
a sparse solver or by reynoldsflow, and the flow across a seal by a sparse solver. A program is imported only
when it is needed. Fields (n1, n2) are sampled at the nodes of a grid of square pixels, and are periodic along
both axes. FFT plans, meshes and bases are created once for all contact states.

Tamaas and ContactMechanics keep no load history; the plastic deformation at a peak load is therefore added to
the gap. Neither program supports a surface that is free along one axis and periodic along the other.
"""

from __future__ import annotations

import logging
from contextlib import suppress
from importlib import import_module

import numpy as np

#: Unknowns up to which a sparse factorisation takes less time than to set multigrid up.
DIRECT = 6000
MODULES = {
    "ASPHER": "aspher",
    "Tamaas": "tamaas",
    "ContactMechanics": "ContactMechanics",
    "ContactMechanics from bearing area": "ContactMechanics",
    "pyamg": "pyamg",
    "PARDISO": "pypardiso",
    "SuperLU": "scipy",
    "reynoldsflow": "reynoldsflow",
}


def present(names):
    """Return the names of the programs that are installed and can be imported."""
    installed = []
    for name in names:
        with suppress(ImportError):
            import_module(MODULES[name])
            installed.append(name)
    return installed


class Tamaas:
    """Solve contacts with Tamaas: Kato's algorithm with a hardness, and Polonsky and Keer's algorithm without one.

    Lengths are divided by the side of the surface, and pressures by the modulus. In SI units, Kato's algorithm
    does not terminate, because its loop that keeps the load has an absolute tolerance.
    """

    def __init__(self, shape, spacing, modulus, hardness, threads=1):
        import tamaas

        tamaas.set_log_level(tamaas.LogLevel.error)
        tamaas.initialize(threads)
        self.size, self.modulus, self.hardness = shape[0] * spacing, modulus, hardness
        sides = [n / shape[0] for n in shape]
        self.model = tamaas.Model(tamaas.model_type.basic_2d, sides, list(shape))
        self.model.E, self.model.nu = 1.0, 0.0

    def __call__(self, gap0, pressure, tolerance):
        """Return the pressure [Pa] and the raw gap [m], negative at the hardness, under a mean pressure [Pa]."""
        import tamaas

        model, mean = self.model, pressure / self.modulus
        heights = np.ascontiguousarray(gap0.mean() - gap0) / self.size
        model.traction[:], model.displacement[:] = mean, 0.0
        if np.isinf(self.hardness):
            solver = tamaas.PolonskyKeerRey(model, heights, tolerance)
        else:
            bound = self.hardness / self.modulus
            solver = tamaas.KatoSaturated(model, heights, tolerance, bound)
        solver.max_iter = 20000
        solver.solve(mean)
        model.solveNeumann()  # the solver leaves displacements that touch at the hardness too
        p = np.array(model.traction) * self.modulus
        raw = np.array(model.displacement) * self.size + gap0
        return p, raw - touching_level(raw, p, self.hardness)


class ContactMechanics:
    """Solve contacts with ContactMechanics: the constrained conjugate gradients of Polonsky and Keer, with a hardness.

    The solution starts from the nominal pressure. From the default initial guess of the program, it did not
    converge at light loads.
    """

    def __init__(self, shape, spacing, modulus, hardness, threads=1):
        from ContactMechanics import PeriodicFFTElasticHalfSpace

        self.sizes = tuple(n * spacing for n in shape)
        self.substrate = PeriodicFFTElasticHalfSpace(shape, modulus, self.sizes)
        self.pixel, self.hardness = spacing**2, hardness

    def __call__(self, gap0, pressure, tolerance):
        """Return the pressure [Pa] and the raw gap [m], like `Tamaas`."""
        import ContactMechanics.Optimization.ConstrainedConjugateGradients as optimization
        from SurfaceTopography import Topography

        elastic = np.isinf(self.hardness)
        highest = pressure if elastic else self.hardness
        result = optimization.constrained_conjugate_gradients(
            self.substrate,
            Topography(gap0.max() - gap0, self.sizes),
            external_force=pressure * self.sizes[0] * self.sizes[1],
            pentol=tolerance * gap0.std(),
            forcetol=tolerance * highest * self.pixel,
            thermotol=tolerance,
            initial_forces=-self.start(gap0, pressure) * self.pixel,
            maxiter=5000,
            **({} if elastic else {"hardness": self.hardness * self.pixel}),
        )
        if not result.success:
            raise RuntimeError(f"ContactMechanics: {result.message}")
        p = np.asarray(result.jac) / self.pixel
        raw = np.asarray(result.x) + gap0
        return p, raw - touching_level(raw, p, self.hardness)

    def start(self, gap0, pressure):
        """Return the initial guess of the pressure [Pa]: the nominal pressure."""
        return np.full(gap0.shape, pressure)


class FromBearingArea(ContactMechanics):
    """Solve contacts with ContactMechanics from a better initial guess, which its manual does not describe."""

    def start(self, gap0, pressure):
        """Return the initial guess of the pressure [Pa]: the hardness at the highest points that carry the load."""
        return np.where(gap0 <= np.quantile(gap0, pressure / self.hardness), self.hardness, 0.0)


class Aspher:
    """Solve elastic contacts with the periodic backend of ASPHER, from coarse to fine grids.

    The grid has 64 · 2^k points per side.

    Lengths are divided by the side of the surface, and pressures by the modulus.
    """

    def __init__(self, shape, spacing, modulus, hardness, threads=1):
        if np.isfinite(hardness) or shape[0] != shape[1]:
            raise ValueError("ASPHER's periodic contact is elastic, on squares")
        self.points, self.size, self.modulus = shape[0], shape[0] * spacing, modulus

    def __call__(self, gap0, pressure, tolerance):
        """Return the pressure [Pa] and the raw gap [m], like `Tamaas`."""
        import aspher

        result = aspher.solve_nested(
            self.points,
            np.ascontiguousarray(gap0 - gap0.min()) / self.size,
            pressure / self.modulus,
            domain_size=1.0,
            E_star=1.0,
            coarsest=64,
            tol=tolerance,
            backend="periodic",
        )
        p = np.asarray(result.pressure).reshape(gap0.shape) * self.modulus
        return p, np.asarray(result.gap).reshape(gap0.shape) * self.size


CONTACTS = {
    "ASPHER": Aspher,
    "Tamaas": Tamaas,
    "ContactMechanics": ContactMechanics,
    "ContactMechanics from bearing area": FromBearingArea,
}


def touching_level(raw, p, hardness):
    """Return the mean raw gap of the points that touch below the hardness.

    If there are no such points, return the quantile of the raw gap that belongs to the contact area.
    """
    inside = (p > 0) & (p < hardness * (1 - 1e-9))
    return raw[inside].mean() if inside.any() else np.quantile(raw, np.mean(p > 0))


def gaps_of_cycle(contact, gap0, loading, unload_from, unloading, tolerance):
    """Solve the gaps at all loads, and then the gaps after unloading from each peak load.

    For unloading, the plastic deformation at the peak load is added to the undeformed gap.
    """
    deformed, gaps = {}, []
    for pressure in loading:
        p, raw = contact(gap0, pressure, tolerance)
        if pressure in unload_from:
            deformed[pressure] = gap0 + np.where(p > 0, np.maximum(-raw, 0), 0)
        gaps.append(np.maximum(raw, 0))
    for peak in unload_from:
        for stop in (stop for stop in unloading if stop < peak):
            gaps.append(np.maximum(contact(deformed[peak], stop, tolerance)[1], 0))
    return gaps


class PlainFlow:
    """Compute the permeability along x1 with bilinear elements of scikit-fem, for square pixels and periodic along x2."""

    def __init__(self, shape, solver="pyamg"):
        from skfem import Basis, BilinearForm, ElementQuad1, MeshQuad, MeshQuad1DG
        from skfem.helpers import dot, grad

        logging.getLogger("skfem").setLevel(logging.ERROR)

        @BilinearForm
        def reynolds(p, q, w):
            return w.h**3 / 12 * dot(grad(p), grad(q))

        n1, n2 = shape
        self.shape, self.form, self.solver = shape, reynolds, solver
        flat = MeshQuad.init_tensor(np.arange(n1 + 1.0), np.arange(n2 + 1.0))
        self.node = tuple(flat.p.astype(int))
        self.gap_basis = Basis(flat, ElementQuad1(), intorder=2)
        last, first = (flat.nodes_satisfying(lambda x, at=at: x[1] == at) for at in (n2, 0))
        ring = MeshQuad1DG.periodic(flat, last, first)
        self.basis = Basis(ring, ElementQuad1(), intorder=2)
        x = self.basis.doflocs[0]
        self.inlet, self.outlet = x == 0, x == n1

    def __call__(self, gap):
        """Compute the permeability, in units of the cube of the gap, from the gap (n1, n2) at the nodes."""
        top = gap.max()
        if top == 0:
            return 0.0
        closed_ring = np.pad(gap, ((0, 1), (0, 1)), mode="wrap") / top
        h = self.gap_basis.interpolate(closed_ring[self.node])
        matrix = self.form.assemble(self.basis, h=h)
        matrix.eliminate_zeros()
        conductance = drop_solved(matrix, self.inlet, self.outlet, self.solver, 1e-6)
        return conductance * top**3 * self.shape[0] / self.shape[1]


def reynoldsflow(gap, solver="auto"):
    """Return permeability (in units of the cube of the gap) and fluid pressure; the gap is constant on each pixel."""
    from reynoldsflow.transport import compute_total_flux, solve_fluid_problem

    top = gap.max()
    gaps, pressure, flux = solve_fluid_problem(gap / top, solver=solver)
    if flux is None:
        return 0.0, None
    return abs(compute_total_flux(gaps, flux, gap.shape[0])[0]) * top**3 / 12, pressure


def drop_solved(matrix, inlet, outlet, solver, tolerance):
    """Compute the flow for a unit pressure drop between two sets of nodes from the matrix of all nodes.

    The flow is 0 if no path connects the two sets.
    """
    from scipy.sparse.csgraph import connected_components

    count, cluster = connected_components(matrix, directed=False)
    through = np.zeros(count, bool)
    through[np.intersect1d(cluster[inlet], cluster[outlet])] = True
    unknown = np.flatnonzero(through[cluster] & ~inlet & ~outlet)
    p = (inlet & through[cluster]).astype(float)
    inner = matrix[unknown][:, unknown]
    p[unknown] = sparse_solution(inner, -(matrix @ p)[unknown], solver, tolerance)
    return float(p @ (matrix @ p))


def sparse_solution(a, b, solver, tolerance):
    """Solve a sparse system with pyamg (Ruge–Stüben multigrid and CG) or PARDISO; small systems with SuperLU."""
    if solver == "SuperLU" or b.size < DIRECT:
        from scipy.sparse.linalg import splu

        if b.size == 0:
            return b
        options = {"SymmetricMode": True}
        order = {"permc_spec": "MMD_AT_PLUS_A", "diag_pivot_thresh": 0.0}
        return splu(a.tocsc(), options=options, **order).solve(b)
    if solver == "PARDISO":
        import pypardiso

        factors = pypardiso.PyPardisoSolver()
        x = pypardiso.spsolve(a.tocsr(), b, solver=factors)
        factors.free_memory(everything=True)
        return x
    import pyamg

    residuals = []
    options = {"accel": "cg", "maxiter": 1000, "residuals": residuals}
    x = pyamg.ruge_stuben_solver(a.tocsr()).solve(b, tol=tolerance, **options)
    if residuals[-1] > tolerance * np.linalg.norm(b):
        raise RuntimeError(f"pyamg: no convergence in {len(residuals) - 1} iterations")
    return x


def network_permeability(k1, k2, solver="SuperLU"):
    """Compute the permeability of a square network of links, periodic along x2."""
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
