"""Measure effects that the model leaves out by small problems.

    python tests/benchmarks/model_limits.py --write

The effects are: gaps that are not thin (Stokes flow), inertia, heat, thin bodies, seats on rings, and yield of
the body below a seat.
"""

from __future__ import annotations

import argparse

import numpy as np
import scipy.sparse as sparse
from scipy.optimize import minimize_scalar
from scipy.sparse.linalg import splu
from scipy.special import ellipk
from skfem import (
    Basis,
    BilinearForm,
    ElementTriP1,
    ElementTriP2,
    ElementVector,
    LinearForm,
    MeshTri,
)
from skfem.helpers import ddot, div, dot, grad, mul

from common import machine_and_time, print_report, table
from femseal import Coated, Solid
from femseal.contact.layered import layer_factor as coated_factor

# channels between a plane and a wall: Reynolds against Stokes and Navier-Stokes


@BilinearForm
def viscous(u, v, _):
    """Return ∇u : ∇v."""
    return ddot(grad(u), grad(v))


@BilinearForm
def conduction(u, v, _):
    """Return ∇u · ∇v."""
    return dot(grad(u), grad(v))


@LinearForm
def source(v, _):
    """Return the load of a unit pressure gradient along the ridges."""
    return v


@BilinearForm
def continuity(u, q, _):
    """Return −q ∇·u."""
    return -q * div(u)


@BilinearForm
def convection(u, v, w):
    """Return the tangent of the convection term at u₀, (u·∇)u₀ · v + (u₀·∇)u · v."""
    return dot(mul(grad(w["u"]), u) + mul(grad(u), w["u"]), v)


@LinearForm
def convected(v, w):
    """Return the convection term at u₀, (u₀·∇)u₀ · v."""
    return dot(mul(grad(w["u"]), w["u"]), v)


@LinearForm
def push(v, _):
    """Return the load of a unit pressure gradient along x."""
    return v[0]


class Channel:
    """Flow between the plane y = 0 and the wall y = h(x), periodic in x, by Taylor-Hood elements (P2/P1).

    The viscosity and the mean pressure gradient are 1.

    Parameters
    ----------
    gap : callable
        Gap h at the points x.
    period : float
        Period of the wall along x.
    elements : tuple of two int
        Number of elements along and across the channel.
    """

    def __init__(self, gap, period=1.0, elements=(384, 8)):
        mesh, left, right, walls = _channel_mesh(gap, period, elements)
        self.period = period
        self.velocity = Basis(mesh, ElementVector(ElementTriP2()), intorder=5)
        pressure = Basis(mesh, ElementTriP1(), intorder=5)
        fixed = self.velocity.get_dofs(walls).all()
        self.free = _joined(self.velocity, left, right, fixed)
        free_pressure = _joined(pressure, left, right, np.array([], int))[:, 1:]
        self.stiffness = self.free.T @ viscous.assemble(self.velocity) @ self.free
        self.divergence = free_pressure.T @ continuity.assemble(self.velocity, pressure) @ self.free
        self.load = self.free.T @ push.assemble(self.velocity)
        self.own = free_pressure.shape[1]

    def _solve(self, matrix, load):
        """Solve the saddle-point problem of velocity and pressure; return the free unknowns of the velocity."""
        saddle = sparse.bmat([[matrix, self.divergence.T], [self.divergence, None]], format="csc")
        return splu(saddle).solve(np.append(load, np.zeros(self.own)))[: load.size]

    def flow(self, density=0.0, start=None):
        """Compute the rate per width, which is the permeability, and the velocity.

        With a density, Newton's method starts from the velocity `start`. The velocity may be the start of
        another solution.
        """
        u = self._solve(self.stiffness, self.load) if start is None else start
        for _ in range(30 if density else 0):
            now = self.velocity.interpolate(self.free @ u)
            tangent = self.free.T @ convection.assemble(self.velocity, u=now) @ self.free
            force = self.free.T @ convected.assemble(self.velocity, u=now)
            new = self._solve(self.stiffness + density * tangent, self.load + density * force)
            change, u = np.abs(new - u).max(), new
            if change < 1e-9 * np.abs(u).max():
                break
        else:
            if density:
                raise ArithmeticError("Newton's iterations do not converge")
        return float(self.load @ u) / self.period, u


def _channel_mesh(gap, period, elements):
    """Return triangles between y = 0 and y = h(x), and the facets on the left, on the right and on the walls."""
    plane = MeshTri.init_tensor(
        *(np.linspace(0, end, n + 1) for end, n in zip((period, 1), elements, strict=True))
    )
    left, right = (
        plane.facets_satisfying(lambda x, at=at: np.isclose(x[0], at)) for at in (0, period)
    )
    walls = plane.facets_satisfying(lambda x: np.isclose(x[1], 0) | np.isclose(x[1], 1))
    return (
        MeshTri(np.vstack([plane.p[0], plane.p[1] * gap(plane.p[0])]), plane.t),
        left,
        right,
        walls,
    )


def flow_along(gap, period, elements):
    """Compute the permeability along the ridges of h(x): the rate per width under a unit pressure gradient, −∇²u = 1."""
    mesh, left, right, walls = _channel_mesh(gap, period, elements)
    basis = Basis(mesh, ElementTriP2())
    free = _joined(basis, left, right, basis.get_dofs(walls).all())
    load = free.T @ source.assemble(basis)
    return (
        float(load @ splu((free.T @ conduction.assemble(basis) @ free).tocsc()).solve(load))
        / period
    )


def _joined(basis, left, right, fixed):
    """Return the matrix (all unknowns, free unknowns) that maps the free unknowns to all unknowns.

    The unknowns on the right end are equal to the unknowns on the left end. Fixed unknowns are 0.
    """
    ends = []
    for facets in (left, right):
        dofs = basis.get_dofs(facets).all()
        _, y = basis.doflocs[:, dofs]
        # both components of a velocity stand at the same place, in the same order
        ends.append(dofs[np.lexsort((dofs, np.round(y, 10)))])
    number = np.arange(basis.N)
    number[ends[1]] = ends[0]
    independent = np.setdiff1d(np.unique(number), fixed)
    column = np.full(basis.N, -1)
    column[independent] = np.arange(independent.size)
    at = np.flatnonzero(column[number] >= 0)
    return sparse.csr_matrix(
        (np.ones(at.size), (at, column[number[at]])), (basis.N, independent.size)
    )


class Wall:
    """A gap h(x) = 1 + Σ a cos(2πnx/L + φ), whose period L is chosen so that the wall has a given rms slope.

    Parameters
    ----------
    amplitudes, phases : arrays (wave,)
        Amplitudes a and phases φ of the waves.
    slope : float
        Rms slope of the wall.
    numbers : array (wave,), optional
        Wave numbers n; by default 1, 2, 3, …
    """

    def __init__(self, amplitudes, phases, slope, numbers=None):
        self.amplitudes, self.phases = np.array(amplitudes, float), np.array(phases, float)
        self.numbers = (
            np.arange(1, self.amplitudes.size + 1) if numbers is None else np.array(numbers)
        )
        # rms slope = 2π/L √(Σ n²a²/2)
        self.period = 2 * np.pi * np.sqrt(np.sum((self.numbers * self.amplitudes) ** 2) / 2) / slope

    def angle(self, x):
        """Return the phase angles of all waves at the points x, (point, wave)."""
        return (
            2 * np.pi * np.multiply.outer(np.asarray(x), self.numbers) / self.period + self.phases
        )

    def gap(self, x):
        """Return the gap at the points x."""
        return 1 + np.cos(self.angle(x)) @ self.amplitudes

    def lubrication(self, columns=20000):
        """Compute the permeability across the ridges by Reynolds' equation, and by the theory of the next order.

        The next order is 1/12k = ⟨(1 + 4h′²/5)/h³⟩. The wall is replaced by a polygon with as many straight
        parts as the finite elements have, because a polygon is narrower and wider than the wall.
        """
        h = self.gap(np.linspace(0, self.period, columns + 1))
        low, high = h[:-1], h[1:]
        inverse = (low + high) / (2 * (low * high) ** 2)
        slope = (high - low) * columns / self.period
        return 1 / (12 * np.mean(inverse)), 1 / (12 * np.mean((1 + 0.8 * slope**2) * inverse))

    def along(self, columns):
        """Compute the permeability along the ridges by Reynolds' equation, and by the next order, 12k = ⟨h³(1 − h′²)⟩."""
        h = self.gap(np.linspace(0, self.period, columns + 1))
        low, high = h[:-1], h[1:]
        cubes = (low + high) * (low**2 + high**2) / 4
        slope = (high - low) * columns / self.period
        return np.mean(cubes) / 12, np.mean((1 - slope**2) * cubes) / 12


def wave(ratio, slope):
    """Return a wall with a single cosine of a relative amplitude."""
    return Wall([ratio], [0.0], slope)


def rough(slope, least=0.1, seed=1, waves=(4, 32), hurst=0.8):
    """Return a wall with a self-affine profile, whose smallest gap is a given fraction of the mean gap."""
    numbers = np.arange(waves[0], waves[1] + 1)
    phases = np.random.default_rng(seed).uniform(0, 2 * np.pi, numbers.size)
    shape = Wall(numbers ** -(0.5 + hurst), phases, 1.0, numbers)
    x = np.linspace(0, shape.period, 20001)
    amplitudes = shape.amplitudes * (1 - least) / (1 - shape.gap(x).min())
    return Wall(amplitudes, phases, slope, numbers)


SLOPES = (0.05, 0.1, 0.2, 0.3, 0.4)


def thin_gap():
    """Tabulate the permeability of Stokes' equations divided by that of Reynolds' equation, by rms slope.

    The values in brackets are those of the theory of the next order. The walls are waves and self-affine
    profiles.
    """
    kinds = {
        "wave, amplitude 0.3 of the mean gap": (lambda s: [wave(0.3, s)], 96),
        "wave, amplitude 0.6": (lambda s: [wave(0.6, s)], 96),
        "wave, amplitude 0.9": (lambda s: [wave(0.9, s)], 192),
        "self-affine, smallest gap 0.3, mean of three profiles": (
            lambda s: [rough(s, 0.3, seed) for seed in range(1, 4)],
            1024,
        ),
        "self-affine, smallest gap 0.1, mean of three profiles": (
            lambda s: [rough(s, 0.1, seed) for seed in range(1, 4)],
            1024,
        ),
    }
    cells = []
    for name, (walls, columns) in kinds.items():
        texts = []
        for slope in SLOPES:
            ratios, next_order = [], []
            for wall in walls(slope):
                reynolds, second = wall.lubrication(columns)
                k, _ = Channel(wall.gap, wall.period, (columns, 8)).flow()
                ratios.append(k / reynolds)
                next_order.append(second / reynolds)
            texts.append(f"{np.mean(ratios):.4f} ({np.mean(next_order):.4f})")
        cells.append([name, *texts])
    for ratio in (0.3, 0.9):
        texts = []
        for slope in SLOPES:
            wall = wave(ratio, slope)
            reynolds, second = wall.along(192)
            texts.append(
                f"{flow_along(wall.gap, wall.period, (192, 8)) / reynolds:.4f} ({second / reynolds:.4f})"
            )
        cells.append([f"wave, amplitude {ratio:g}, along its ridges", *texts])
    cells.append(["1/(1 + h′²)", *(f"{1 / (1 + s**2):.4f}" for s in SLOPES)])
    return table(["channel", *(f"rms slope {s:g}" for s in SLOPES)], cells)


def element_order():
    """Compute the errors of the permeability on two meshes against a finer mesh, for the steepest wave."""
    wall = wave(0.9, 0.4)
    meshes = ((96 * n, 2 * n) for n in (1, 2, 4))
    k = [
        Channel(wall.gap, wall.period, mesh).flow()[0] / wall.lubrication(mesh[0])[0]
        for mesh in meshes
    ]
    return [abs(v / k[-1] - 1) for v in k[:-1]]


def inertia():
    """Tabulate the permeability divided by that of Stokes flow, by Reynolds number times gap over wavelength."""
    shown, steps = (0.3, 1, 3, 10), (0.3, 1, 2, 3, 4.5, 6.5, 8, 10)
    cells = []
    for ratio, slope in ((0.3, 0.1), (0.6, 0.1), (0.6, 0.2), (0.9, 0.1)):
        wall = wave(ratio, slope)
        channel = Channel(wall.gap, wall.period, (96, 6))
        stokes, u = channel.flow()
        rate, texts = stokes, []
        try:
            for number in steps:
                # Re × gap over wave: density × rate × mean gap over period; the rate follows the density
                for _ in range(2):
                    rate, u = channel.flow(number * wall.period / rate, u)
                if number in shown:
                    texts.append(f"{rate / stokes:.4f}")
        except ArithmeticError:
            texts += ["–"] * (len(shown) - len(texts))
        cells.append([f"amplitude {ratio:g}, rms slope {slope:g}", *texts])
    return table(["wave", *(f"{n:g}" for n in shown)], cells)


def inertia_of_classes():
    """Tabulate the Reynolds number of the gap (mass rate per length over viscosity) for leakages of some classes."""
    leaks = (
        ("helium, class L0.01", 1e-8, 1.96e-5),
        ("helium, L1", 1e-6, 1.96e-5),
        ("water, 1 mL/(m·min)", 1e-3 / 60, 1e-3),
        ("water, 1 L/(m·min)", 1 / 60, 1e-3),
    )
    return table(
        ["leakage", "Re"], [[name, f"{mass / viscosity:.2g}"] for name, mass, viscosity in leaks]
    )


# heat


def heat():
    """Tabulate the temperature rise of a throttled liquid, and the length in which the walls take its heat."""
    cells = []
    # density × heat capacity [J/(m³ K)], diffusivity [m²/s]
    for name, capacity, diffusivity in (("water", 4.18e6, 1.4e-7), ("mineral oil", 1.7e6, 7e-8)):
        for rate in (1e-9, 1e-6):
            # a parcel gives its heat to the walls over gap²/diffusivity × velocity = gap × rate/diffusivity
            cells.append(
                [name, f"{rate:.0e}", f"{1e7 / capacity:.1f}", f"{rate / diffusivity:.1g}"]
            )
    return table(
        [
            "liquid",
            "leakage [m²/s]",
            "temperature rise for a drop of 10 MPa, if the walls take no heat [K]",
            "length in which the walls take the heat / gap",
        ],
        cells,
    )


# thin bodies


def layer_factor(thickness):
    """Compute the compliance of a layer on a frictionless rigid base, divided by that of a half-space, under a wave.

    The factor is (cosh 2ξ − 1)/(sinh 2ξ + 2ξ) with ξ = 2π × thickness, and the thickness in wavelengths.
    """
    twice = 4 * np.pi * np.asarray(thickness)
    return (np.cosh(twice) - 1) / (np.sinh(twice) + twice)


def layers():
    """Tabulate the compliance of layers on a rigid base, divided by the compliance of a half-space."""
    thicknesses = (0.1, 0.2, 0.3, 0.5, 0.75, 1.0)
    head = ["thickness / wavelength", *(f"{t:g}" for t in thicknesses)]
    return table(
        head,
        [
            [
                "frictionless base",
                *(f"{layer_factor(t):.3f}" for t in thicknesses),
            ],
            *([f"bonded, ν = {nu:g}", *bonded_layer(nu, thicknesses)] for nu in (0.3, 0.5)),
        ],
    )


def bonded_layer(poisson, thicknesses):
    """Return the compliance of a layer that is bonded to the base, divided by that of a half-space, as texts."""
    body = Coated(None, Solid(1.0, poisson), 1.0)
    return [f"{S:.3f}" for S in coated_factor(body, 2 * np.pi * np.array(thicknesses))]


# a ring seat: axisymmetric half-space against plane strain


def ring_kernel(radii, step):
    """Return the matrix (point, ring) of the displacements at radii by unit pressures on rings of the width `step`.

    For E* = 1, the displacement is u(r) = (4/π) ∫ p(s) s/(r + s) K(m) ds with m = 4rs/(r + s)². The logarithmic
    singularity of K is integrated in closed form over the nearest rings.
    """
    r, s = radii[:, None], radii[None, :]
    m1 = ((r - s) / (r + s)) ** 2
    with np.errstate(divide="ignore"):
        smooth = ellipk(1 - np.where(m1 > 0, m1, 1e-300)) * s / (r + s)
    kernel = 4 / np.pi * smooth * step
    # near the diagonal K(m) = ln(4/√m1): exact mean of −ln|x| over a ring, for the nearest ones
    near = np.abs(r - s) < 4.5 * step
    x = np.abs(r - s) / step
    high, low = x + 0.5, x - 0.5
    logs = (
        np.log(step)
        + high * np.log(high)
        - np.where(low == 0, 0, low * np.log(np.abs(low) + (low == 0)))
        - 1
    )
    mean = (np.log(4 * (r + s)) - logs) * s / (r + s)
    return np.where(near, 4 / np.pi * mean * step, kernel)


def strip_kernel(points, step):
    """Return the matrix of the displacements of an endless strip, u = −(2/π) ∫ p(s) ln|x − s| ds for E* = 1."""
    x = np.abs(points[:, None] - points[None, :]) / step
    high, low = x + 0.5, x - 0.5
    logs = np.log(step) + high * np.log(high) - np.sign(low) * np.abs(low) * np.log(np.abs(low)) - 1
    return -2 / np.pi * logs * step


def pressed(kernel, gap, weights, force):
    """Compute the contact pressure p ≥ 0 of a given force with an active-set method.

    Where the bodies touch, gap + kernel p equals the approach.
    """
    touching = gap < np.quantile(gap, 0.3)
    for _ in range(200):
        n = int(touching.sum())
        matrix = np.zeros((n + 1, n + 1))
        matrix[:n, :n], matrix[:n, n], matrix[n, :n] = (
            kernel[np.ix_(touching, touching)],
            -1,
            weights[touching],
        )
        solution = np.linalg.solve(matrix, np.append(-gap[touching], force))
        p = np.zeros(gap.size)
        p[touching] = solution[:n]
        left = gap + kernel @ p - solution[n]
        new = (touching & (p > 0)) | (~touching & (left < 0))
        if (new == touching).all():
            break
        touching = new
    return p


def rings(points=900):
    """Tabulate the contact of a crowned seat on a ring relative to plane strain, under the same force per length."""
    cells = []
    for ratio in (0.01, 0.03, 0.1, 0.2, 0.3):
        # half-width a = 1, E* = 1, crown radius ρ: Hertz's force per length π a²E*/4ρ with ρ = 100
        crown, mean = 100.0, 1 / ratio
        x = (np.arange(points) + 0.5) / points * 3 - 1.5
        step = x[1] - x[0]
        gap = x**2 / (2 * crown)
        force = np.pi / (4 * crown)
        strip = pressed(strip_kernel(x, step), gap, np.full(points, step), force)
        ring = pressed(ring_kernel(mean + x, step), gap, step * (mean + x) / mean, force)
        ends = [x[p > 0] for p in (strip, ring)]
        breadth = [e[-1] - e[0] + step for e in ends]
        middle = (ends[1][0] + ends[1][-1]) / 2
        moved = np.interp(x, x - middle, ring)
        cells.append(
            [
                f"{ratio:g}",
                f"{breadth[1] / breadth[0]:.3f}",
                f"{ring.max() / strip.max():.3f}",
                f"{middle:+.3f}",
                f"{np.sqrt(np.mean((moved - strip)[np.abs(x) < 1] ** 2)) / strip.max():.3f}",
            ]
        )
    head = [
        "half-width / radius",
        "width / width in plane strain",
        "peak pressure / peak pressure in plane strain",
        "outward shift of the centre of the band [half-widths]",
        "rms difference of the pressures about the centres of both bands / peak pressure",
    ]
    return table(head, cells)


# yield below a line contact


def line_contact_yield(poisson=0.3):
    """Return the peak pressure p0/σ_y at first yield below a line contact, and the depth over the half-width.

    On the axis at the depth z, σ_x = −p0 ((a² + 2z²)/√(a² + z²) − 2z)/a and σ_z = −p0 a/√(a² + z²) (Johnson
    1985, eq. 4.46).
    """

    def mises(z):
        """Compute the von Mises stress divided by p0 at the depth z, in half-widths."""
        root = np.hypot(1, z)
        s_x, s_z = -((1 + 2 * z**2) / root - 2 * z), -1 / root
        s_y = poisson * (s_x + s_z)
        return np.sqrt(((s_x - s_y) ** 2 + (s_y - s_z) ** 2 + (s_z - s_x) ** 2) / 2)

    deepest = minimize_scalar(lambda z: -mises(z), bounds=(0, 3), method="bounded")
    return 1 / mises(deepest.x), float(deepest.x)


def yields():
    """Tabulate the pressure and the depth of first yield below a line contact, by Poisson's ratio."""
    cells = []
    for poisson in (0.25, 0.3, 0.35):
        peak, depth = line_contact_yield(poisson)
        cells.append(
            [
                f"{poisson:g}",
                f"{peak:.2f}",
                f"{peak / 2.8:.2f}",
                f"{np.pi / 4 * peak / 2.8:.2f}",
                f"{depth:.2f}",
            ]
        )
    head = [
        "ν",
        "p0/σ_y at first yield",
        "p0/H, H = 2.8 σ_y",
        "mean pressure / H",
        "depth / half-width",
    ]
    return table(head, cells)


def main():
    """Run all parts of the benchmark, and print and write the report."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--write", action="store_true", help="write the report")
    options = parser.parse_args()
    orders = element_order()
    text = [
        "## Thin gap\n\nThe table shows the permeability from the Stokes equations divided by the permeability from Reynolds' equation. "
        "The values in brackets are predictions of next-order lubrication theory.",
        thin_gap(),
        "For the wave of amplitude 0.9 and slope 0.4, the solution of the Stokes equations on 384 × 8 elements is the "
        f"reference. The error is {orders[0]:.1e} on 96 × 2 elements and {orders[1]:.1e} on 192 × 4 elements.",
        "## Inertia\n\nThe table shows the permeability from the Navier-Stokes equations divided by the "
        "permeability from the Stokes equations. The column headings are values of the Reynolds number times the ratio of mean gap to wavelength.",
        inertia(),
        "The next table shows the Reynolds number at some leakages:",
        inertia_of_classes(),
        "## Heat",
        heat(),
        "## Thin bodies\n\nThe table shows the compliance of a layer on a rigid base divided by the compliance of a half-space.",
        layers(),
        "## Seats on rings",
        rings(),
        "## Yield below a seat",
        yields(),
    ]
    report = "\n\n".join([machine_and_time(["scikit-fem"]), *text])
    print_report(__file__, "Limits of the model", report, options.write)


if __name__ == "__main__":
    main()
