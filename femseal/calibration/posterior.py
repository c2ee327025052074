"""Posterior of hardness, shortest wave and factor, from a leak test and a surrogate of the leakage (Bayes' rule).

The test is the factor times the model: ln(measured) is normal around ln(factor) + ln(model), with the error of the
test, independent at each row, and that of the surrogate, correlated between loads. A sealed row is one whose model is
closed, or leaks less than the limit. Priors are uniform in the logarithm within ranges. Sampled by emcee's
affine-invariant ensemble (Foreman-Mackey et al. 2013).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr

from ..base.arrays import Array
from ..sweeps.surrogate import Surrogate
from .leak_test import LeakTest

#: What is calibrated, in the order of all arrays, with its unit.
UNITS = {"hardness": "Pa", "shortest_wave": "m", "factor": ""}
#: Probability of the regions that are given; members of the ensemble.
PROBABILITY, WALKERS = 0.9, 96


@dataclass(frozen=True)
class Estimate:
    """A quantity in SI: its median, and the shortest interval that holds it with the probability `PROBABILITY`."""

    median: float
    lower: float
    upper: float

    @classmethod
    def of(cls, values: Array) -> Estimate:
        """From samples of a posterior."""
        ordered = np.sort(values)
        count = int(np.ceil(PROBABILITY * len(ordered)))
        n = int(np.argmin(np.log(ordered[count - 1 :] / ordered[: len(ordered) - count + 1])))
        return cls(float(np.median(ordered)), float(ordered[n]), float(ordered[n + count - 1]))


@dataclass(frozen=True, eq=False)
class Posterior:
    """Density of the three quantities in the unit cube: their logarithms between the ends of their ranges (3, 2).

    rows : load of the surrogate of each row of the test. error : relative, of the measured leakages.
    """

    test: LeakTest
    rows: list[int]
    ranges: Array
    surrogate: Surrogate
    error: float

    def quantities(self, cube: Array) -> Array:
        """The quantities in SI (n, 3) at points of the unit cube."""
        low, high = np.log(self.ranges).T
        return np.asarray(np.exp(low + cube * (high - low)))

    def curves(self, cube: Array) -> tuple[Array, Array, Array]:
        """ln(leakage) of the test by the model, its error by the surrogate, and whether it is open, (n, rows)."""
        mean, deviation, is_open = (part[:, self.rows] for part in self.surrogate.at(cube[:, :2]))
        return mean + np.log(self.quantities(cube)[:, 2:]), deviation, is_open

    def log_density(self, cube: Array) -> Array:
        """ln of the density, but for a constant (n,)."""
        inside = ((cube >= 0) & (cube <= 1)).all(axis=1)
        value = np.full(len(cube), -np.inf)
        if not inside.any():
            return value
        mean, deviation, is_open = self.curves(cube[inside])
        low, measured = self.test.sealed, np.log(self.test.leakage)
        below = ndtr((measured - mean)[:, low] / np.hypot(deviation[:, low], self.error))
        found = np.log(1 - is_open[:, low] * (1 - below)).sum(1) + np.log(is_open[:, ~low]).sum(1)
        steps = np.array(self.rows)[~low]
        deviation, rest = deviation[:, ~low], (measured - mean)[:, ~low]
        covariance = self.surrogate.correlation[np.ix_(steps, steps)] * deviation[:, :, None] * deviation[:, None]
        root = np.linalg.cholesky(covariance + self.error**2 * np.eye(len(steps)))
        white = np.linalg.solve(root, rest[..., None])[..., 0]
        found -= 0.5 * (white**2).sum(1) + np.log(np.diagonal(root, axis1=1, axis2=2)).sum(1)
        value[inside] = found
        return value

    def samples(self, count: int, seed: int, steps: int) -> Array:
        """Samples of the posterior in the unit cube (count, 3), after a third of the steps of the ensemble.

        The ensemble starts at random points of the cube, drawn without repetition by their density (Gumbel's trick).
        """
        import emcee

        rng = np.random.default_rng(seed)
        start = rng.random((100 * WALKERS, 3))
        start = start[np.argsort(self.log_density(start) + rng.gumbel(size=len(start)))[-WALKERS:]]
        sampler = emcee.EnsembleSampler(WALKERS, 3, self.log_density, vectorize=True)
        sampler.run_mcmc(emcee.State(start, random_state=np.random.RandomState(seed).get_state()), steps)
        chain = sampler.get_chain(discard=steps // 3, flat=True)
        return np.asarray(chain[np.linspace(0, len(chain) - 1, count).astype(int)])
