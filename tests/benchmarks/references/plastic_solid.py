"""Solve the contact of a half-space that yields below its surface by von Mises' criterion, with Tamaas.

Tamaas computes the plastic strain below a given contact pressure (Frérot, Bonnet, Molinari & Anciaux, Comput.
Methods Appl. Mech. Eng. 351, 2019, 951). The coupling with the contact that Tamaas contains, a relaxation of
the residual displacement, needs hundreds of such solutions. The coupling in this module is a proximal
iteration, and needs about ten.

Let X(p) be the displacement of the surface by the plastic strain below the pressure p, and K p the elastic
displacement. The pressure of the next iteration is that of the elastic contact of the initial gap plus X(p) − β
K p, for a half-space that is 1 + β times as compliant. It minimises the complementary energy, whose unknown
curvature is replaced by (1 + β) K. A fixed point is a solution for every β, because both terms with β cancel.
Anderson mixing accelerates the iteration.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

import femseal as fs

try:
    import tamaas
    from tamaas.nonlinear_solvers import DFSANECXXSolver
except ImportError:  # the peer is optional
    tamaas = None

#: What to say where Tamaas is missing.
MISSING = "Tamaas is not installed, so nothing can be solved: pip install tamaas"
YOUNG, POISSON = 1.0, 0.3
MODULUS = YOUNG / (1 - POISSON**2)
#: Pairs of pressures that Anderson mixing combines.
_MIXED = 8
#: Error of the strain, relative to the yield strain, to which Tamaas solves at the end of an iteration.
_STRAIN_TOLERANCE = 1e-4


@dataclass(frozen=True)
class Pressed:
    """State of a contact.

    Parameters
    ----------
    pressure, gap : arrays (n, n)
        Contact pressure and gap.
    error : float
        Mean change of the pressure in the last iteration, divided by the mean pressure.
    iterations : int
        Number of iterations.
    """

    pressure: np.ndarray
    gap: np.ndarray
    error: float
    iterations: int


class PlasticSolid:
    """A periodic half-space of side 1 with von Mises plasticity and linear isotropic hardening.

    Parameters
    ----------
    points : int
        Number of points per side.
    layers : int
        Number of layers of points down to `depth`.
    depth : float
        Depth below which no point yields.
    yield_stress : float
        Yield stress.
    hardening : float
        Hardening dσ/dε divided by Young's modulus.
    """

    def __init__(self, points, layers, depth, yield_stress, hardening):
        if tamaas is None:
            raise SystemExit(MISSING)
        tamaas.set_log_level(tamaas.LogLevel.error)
        self.points, self.yield_stress = points, yield_stress
        kind = tamaas.model_type.volume_2d
        self.model = tamaas.ModelFactory.createModel(
            kind, [depth, 1.0, 1.0], [layers, points, points]
        )
        self.model.E, self.model.nu = YOUNG, POISSON
        self.material = tamaas.materials.IsotropicHardening(
            self.model, sigma_y=yield_stress, hardening=hardening * YOUNG
        )
        self.residual = tamaas.Residual(self.model, self.material)
        self.solver = DFSANECXXSolver(self.residual)
        self.strain_increment = np.asarray(self.solver.getStrainIncrement())
        self.kept_pressure = self.kept_displacement = np.zeros((points, points))
        waves = np.fft.fftfreq(points, 1 / points)
        q = 2 * np.pi * np.hypot(waves[:, None], waves[None, :])
        self._kernel = np.divide(2 / MODULUS, q, out=np.zeros_like(q), where=q > 0)

    def elastic_displacement(self, pressure):
        """Return the elastic displacement K p, whose mean is 0."""
        return np.fft.ifft2(self._kernel * np.fft.fft2(pressure)).real

    def plastic_displacement(self, pressure, tolerance=_STRAIN_TOLERANCE):
        """Return the plastic displacement X(p), whose mean is 0, from the last stored state.

        The tolerance refers to the strain divided by the yield strain. Tamaas takes the traction since the last
        stored state, and returns the displacement by the plastic strain since then.
        """
        self.model.traction[..., 2] = pressure - self.kept_pressure
        size = np.sqrt(self.strain_increment.size)
        self.solver.tolerance = tolerance * self.yield_stress / YOUNG * size
        self.solver.solve()
        surface = np.asarray(self.model.displacement)[0, ..., 2]
        self._displacement = self.kept_displacement + surface - surface.mean()
        self._pressure = pressure
        return self._displacement

    def keep(self):
        """Store the plastic strain of the last solution; the next solutions begin from it."""
        self.solver.updateState()
        self.strain_increment[...] = 0.0
        self.kept_pressure, self.kept_displacement = self._pressure, self._displacement


def press(solid, gap0, pressure, start, tolerance=1e-3, beta=8.0, most=60):
    """Press a rough rigid surface on the solid, from the last stored state.

    Parameters
    ----------
    solid : PlasticSolid
        Solid that yields.
    gap0 : array (n, n)
        Initial gap.
    pressure : float
        Mean pressure.
    start : array (n, n)
        Initial guess of the pressure.
    tolerance : float
        Mean change of the pressure in an iteration, divided by the mean pressure, at which the iteration stops.
    beta : float
        Parameter β of the proximal iteration, see the module.
    most : int
        Largest number of iterations.
    """
    points = solid.points
    soft = fs.HalfSpace((points, points), (1 / points, 1 / points), MODULUS / (1 + beta))
    p = start * (pressure / start.mean())
    error, iteration = 1.0, 0
    pressures, changes = [], []
    while error >= tolerance and iteration < most:
        iteration += 1
        accuracy = np.clip(0.03 * error, _STRAIN_TOLERANCE, 10 * _STRAIN_TOLERANCE)
        plastic = solid.plastic_displacement(p, accuracy)
        raised = gap0 + plastic - beta * solid.elastic_displacement(p)
        contact = fs.solve_contact(raised - raised.min(), soft, pressure=pressure, rtol=1e-7)
        change = contact.pressure - p
        error = np.abs(change).mean() / pressure
        if error < tolerance:
            break
        pressures = [*pressures, p][-_MIXED:]
        changes = [*changes, change][-_MIXED:]
        p = np.maximum(_anderson(pressures, changes), 0.0)
        p *= pressure / p.mean()
    return Pressed(contact.pressure, _gap(solid, gap0 + plastic, pressure), error, iteration)


def _gap(solid, raised, pressure):
    """Return the gap of the elastic contact of the surface with the plastic displacement."""
    points = solid.points
    body = fs.HalfSpace((points, points), (1 / points, 1 / points), MODULUS)
    return fs.solve_contact(raised - raised.min(), body, pressure=pressure, rtol=1e-7).gap


def _anderson(pressures, changes):
    """Combine the last pressures p and their changes so that the combined change is smallest; return the next pressure."""
    p, f = pressures[-1], changes[-1]
    if len(changes) == 1:
        return p + f
    steps = np.diff([q.ravel() for q in pressures], axis=0).T
    curves = np.diff([g.ravel() for g in changes], axis=0).T
    weights = np.linalg.lstsq(curves, f.ravel(), rcond=1e-6)[0]
    return p + f - ((steps + curves) @ weights).reshape(p.shape)
