"""Compute the posterior of hardness, shortest wave and factor from a leak test, by Bayes' rule.

The measured leakage is assumed to be the factor times the leakage of the model. It is assumed that ln(measured leakage)
is normally distributed with the mean ln(factor) + ln(leakage of the model). The covariance of ln(measured leakage) at
several loads has two parts: the errors of the test, which are independent of each other, and the errors of the
surrogate, which are correlated between loads. If no leakage was detected at a load, the leak test has a sealed row. For
a sealed row, the model must be sealed as well, or leak less than the limit of detection. The prior of each quantity is
uniform in the logarithm of the quantity, within a given range.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr
from scipy.stats import qmc

from ..base import Array
from .leak_test import LeakTest
from .surrogate import Prediction, Surrogate

#: Units of the calibrated quantities, in the order of all arrays.
QUANTITY_UNITS = {"hardness": "Pa", "shortest_wave": "m", "factor": ""}
#: Index of the factor among the calibrated quantities.
_FACTOR_INDEX = 2
#: Probability that the intervals of the calibrated quantities contain the true value.
PROBABILITY = 0.9
#: Fraction of the probability that may be neglected when only the most probable squares are divided further.
_NEGLECTED_PROBABILITY = 1e-4
#: Number of slabs along ln(factor) for each square of the plane of hardness and shortest wave, see `Posterior.samples`.
_SLABS = 24
#: Distance of the first and the last slab from the mean of ln(factor), in standard deviations of ln(factor).
_SLAB_RANGE = 4.5


@dataclass(frozen=True)
class Estimate:
    """Median and interval of a calibrated quantity in SI units.

    On a logarithmic scale, this is the shortest interval that contains the quantity with the probability `PROBABILITY`.
    """

    median: float
    lower: float
    upper: float

    @classmethod
    def from_samples(cls, values: Array) -> Estimate:
        """Compute the median and the interval of a quantity above 0 from samples of its posterior (n,)."""
        ordered = np.sort(values)
        # the candidates are all intervals that begin and end at a sample and contain `count` samples
        count = int(np.ceil(PROBABILITY * len(ordered)))
        starts = ordered[: len(ordered) - count + 1]
        ends = ordered[count - 1 :]
        shortest = np.argmin(np.log(ends / starts))
        return cls(float(np.median(ordered)), float(starts[shortest]), float(ends[shortest]))


@dataclass(frozen=True, eq=False)
class FactorDensity:
    """Posterior density of ln(factor) for several pairs of hardness and shortest wave.

    The posterior density is a product of two terms: a normal density of ln(factor), which follows from the measured
    leakages, and the probabilities of the rows in which the test found no leakage.

    Parameters
    ----------
    mean, deviation : array (pairs, 1)
        Mean and standard deviation of ln(factor) in the normal density.
    misfit : array (pairs, 1)
        Sum of the squares of the standardised residuals ln(measured leakage) − ln(model) − mean, over the rows of the
        test with a leakage.
    log_scale : array (pairs, 1)
        Part of ln(density) that depends neither on `misfit` nor on the factor.
    sealed_limit : array (pairs, sealed rows)
        ln(limit of detection) − ln(leakage of the model) for each sealed row.
    sealed_deviation : array (pairs, sealed rows)
        Standard deviation of ln(limit of detection / leakage of the model) for each sealed row.
    sealed_is_open : array (pairs, sealed rows)
        Probability that the model leaks at the load of each sealed row.
    """

    mean: Array
    deviation: Array
    misfit: Array
    log_scale: Array
    sealed_limit: Array
    sealed_deviation: Array
    sealed_is_open: Array

    def log_density(self, log_factor: Array) -> Array:
        """Compute ln(density), up to a constant, at m values of ln(factor) for each pair, (pairs, m).

        ln(density) is log_scale − (misfit + ((ln(factor) − mean)/deviation)²)/2, plus the logarithm of the probability
        of each sealed row. A sealed row has the probability that the leakage of the model, multiplied by the factor,
        does not exceed the limit of detection.
        """
        standardised = (log_factor - self.mean) / self.deviation
        log_density = self.log_scale - 0.5 * (self.misfit + standardised**2)
        for row in range(self.sealed_limit.shape[1]):
            limit = self.sealed_limit[:, row, None]
            # probability that the model leaks more than the limit, provided that it leaks
            exceeds_limit = ndtr((log_factor - limit) / self.sealed_deviation[:, row, None])
            log_density += np.log(1 - self.sealed_is_open[:, row, None] * exceeds_limit)
        return log_density


@dataclass(frozen=True, eq=False)
class _Slabs:
    """A grid over the posterior density, whose cells are called slabs.

    The unit square of hardness and shortest wave is divided into small squares. Above each small square, the range of
    ln(factor) is divided into slabs of equal width.

    Parameters
    ----------
    centres : array (squares, 2)
        Centres of the small squares, as points of the unit square.
    n_along_side : int
        Number of small squares that would fit along a side of the unit square.
    first, last : array (squares, 1)
        Lowest and highest value of ln(factor) that the slabs above each small square cover.
    probability : array (squares, slabs)
        Posterior probability of each slab, up to a constant factor.
    """

    centres: Array
    n_along_side: int
    first: Array
    last: Array
    probability: Array


@dataclass(frozen=True, eq=False)
class Posterior:
    """Compute and sample the posterior density in the unit cube.

    The three coordinates of the unit cube are the logarithms of hardness, shortest wave and factor, scaled so that the
    range of each quantity becomes the interval from 0 to 1.

    Parameters
    ----------
    test : LeakTest
        The leak test.
    rows : list of int
        For each row of the test, the index of its load among the loads of the surrogate.
    ranges : array (3, 2)
        Lower and upper ends of the range of hardness, shortest wave and factor, in SI units.
    surrogate : Surrogate
        Prediction of the leakage of the model.
    error : float
        Relative standard deviation of the measured leakages.
    """

    test: LeakTest
    rows: list[int]
    ranges: Array
    surrogate: Surrogate
    error: float

    def quantities(self, cube: Array) -> Array:
        """Convert points of the unit cube (n, 3) to hardness, shortest wave and factor in SI units (n, 3)."""
        low, high = np.log(self.ranges).T
        return np.asarray(np.exp(low + cube * (high - low)))

    def predict(self, cube: Array) -> Prediction:
        """Predict the leakage of the model times the factor for every row of the test, at points of the cube (n, 3)."""
        model = self._predict_rows(cube[:, :2])
        log_factor = np.log(self.quantities(cube)[:, 2:])
        return Prediction(model.mean + log_factor, model.deviation, model.is_open)

    def _predict_rows(self, plane: Array) -> Prediction:
        """Predict the leakage of the model for every row of the test, before multiplication by the factor.

        plane : pairs of hardness and shortest wave, scaled to points of the unit square, array (pairs, 2).
        """
        mean, deviation, is_open = self.surrogate.predict(plane)
        return Prediction(mean[:, self.rows], deviation[:, self.rows], is_open[:, self.rows])

    def factor_density(self, plane: Array) -> FactorDensity:
        """Compute the posterior density of ln(factor) for several pairs of hardness and shortest wave.

        The factor is fitted by generalised least squares. For each pair, let r be the residuals ln(measured leakage) −
        ln(leakage of the model) in the rows of the test that have a leakage. The covariance C of the residuals is the
        covariance of the surrogate plus the variance of the test. The best constant value of ln(factor) is 1·C⁻¹r /
        1·C⁻¹1, with the variance 1 / 1·C⁻¹1, where 1 is a vector of ones.

        plane : pairs of hardness and shortest wave, scaled to points of the unit square, array (pairs, 2).
        """
        mean, deviation, is_open = self._predict_rows(plane)  # (pair, row) each
        is_sealed = self.test.sealed  # (row,)
        leaks = ~is_sealed
        residuals = np.log(self.test.leakage) - mean  # (pair, row)
        loads = np.array(self.rows)[leaks]
        errors = deviation[:, leaks]  # (pair, row with a leakage)
        correlation = self.surrogate.correlation[np.ix_(loads, loads)]
        surrogate_covariance = correlation * errors[:, :, None] * errors[:, None]
        covariance = surrogate_covariance + self.error**2 * np.eye(len(loads))  # (pair, row, row)
        # With the Cholesky factor L of C, the residuals L⁻¹r are independent with the variance 1, and the fit becomes
        # ordinary least squares of L⁻¹r as a multiple of L⁻¹1.
        root = np.linalg.cholesky(covariance)
        columns = np.stack([residuals[:, leaks], np.ones_like(errors)], axis=-1)  # (pair, row, 2)
        white_columns = np.linalg.solve(root, columns)
        white_residuals = white_columns[..., 0]
        white_ones = white_columns[..., 1]
        factor_deviation = (white_ones**2).sum(1, keepdims=True) ** -0.5
        factor_mean = (white_ones * white_residuals).sum(1, keepdims=True) * factor_deviation**2
        misfit = ((white_residuals - white_ones * factor_mean) ** 2).sum(1, keepdims=True)
        log_open = np.log(is_open[:, leaks]).sum(1)  # the model must leak where the test leaks
        log_root_determinant = np.log(np.diagonal(root, axis1=1, axis2=2)).sum(1)  # ln|L|
        return FactorDensity(
            mean=factor_mean,
            deviation=factor_deviation,
            misfit=misfit,
            log_scale=(log_open - log_root_determinant)[:, None],
            sealed_limit=residuals[:, is_sealed],
            sealed_deviation=np.hypot(deviation[:, is_sealed], self.error),
            sealed_is_open=is_open[:, is_sealed],
        )

    def samples(self, count: int) -> Array:
        """Draw quasi-random samples of the posterior in the unit cube.

        The unit square of hardness and shortest wave is divided into small squares, four times as many as samples. If a
        quarter of the small squares contains nearly all of the probability, the others are dropped, and each of the
        remaining ones is divided into four. The division is repeated until the probability is spread over more than a
        quarter of the small squares. Above each small square, the range of ln(factor) is divided into slabs. For each
        sample, a Sobol sequence chooses a slab, according to the probabilities, and then a point in it.

        The samples are insensitive to rounding errors. If the last digits of the density change, few samples move, and
        these move only to a neighbouring square. With a Markov chain, rounding errors would change all later samples.

        Parameters
        ----------
        count : int
            Number of samples, a power of 2.

        Returns
        -------
        array (count, 3)
        """
        slabs = self._probable_slabs(4 * count)
        # Each sample has four random numbers from 0 to 1. The first number chooses the slab. The other three numbers
        # are the position in the slab along hardness, shortest wave and ln(factor).
        random = qmc.Sobol(4, rng=np.random.default_rng(1)).random_base2(count.bit_length() - 1)
        # a slab is chosen where the cumulative probability of all slabs reaches the first random number
        cumulative = np.cumsum(slabs.probability) / slabs.probability.sum()
        # the slabs are numbered square by square, as in the array `probability` (square, slab)
        number = np.searchsorted(cumulative[:-1], random[:, 0])
        square, slab = np.divmod(number, _SLABS)
        plane = slabs.centres[square] + (random[:, 1:3] - 0.5) / slabs.n_along_side
        width = (slabs.last - slabs.first)[square, 0]
        log_factor = slabs.first[square, 0] + width * (slab + random[:, 3]) / _SLABS
        low, high = np.log(self.ranges[_FACTOR_INDEX])
        return np.c_[plane, (log_factor - low) / (high - low)]

    def _probable_slabs(self, least_count: int) -> _Slabs:
        """Divide the unit square of hardness and shortest wave into small squares, and these into slabs, see `samples`.

        least_count : smallest number of small squares, approximately.
        """
        n_along_side = round(least_count**0.5)
        # (square, axis): the squares are numbered row by row
        centres = (np.indices((n_along_side, n_along_side)).reshape(2, -1).T + 0.5) / n_along_side
        while True:
            slabs = self._slabs(centres, n_along_side)
            probability = slabs.probability.sum(1)  # (square,)
            most_probable_first = np.argsort(-probability, kind="stable")
            best = np.sort(most_probable_first[: len(centres) // 4])
            nearly_all = (1 - _NEGLECTED_PROBABILITY) * probability.sum()
            best_have_nearly_all = probability[best].sum() >= nearly_all
            if not best_have_nearly_all:
                return slabs
            # drop all other squares, and divide each of the best squares into four
            n_along_side *= 2
            # from the centre of a square, the centres of its quarters are half a quarter away along both axes
            to_quarters = np.array([[-1, -1], [-1, 1], [1, -1], [1, 1]]) / (2 * n_along_side)
            centres = (centres[best, None] + to_quarters).reshape(-1, 2)

    def _slabs(self, centres: Array, n_along_side: int) -> _Slabs:
        """Divide the range of ln(factor) above small squares into slabs, and compute their probabilities.

        The slabs cover the part of the range of ln(factor) that lies within `_SLAB_RANGE` standard deviations of the
        mean.

        centres : centres of the small squares (squares, 2).
        n_along_side : number of small squares that would fit along a side of the unit square.
        """
        low, high = np.log(self.ranges[_FACTOR_INDEX])
        density = self.factor_density(centres)
        centre = np.clip(density.mean, low, high)
        first = np.clip(centre - _SLAB_RANGE * density.deviation, low, high)
        last = np.clip(centre + _SLAB_RANGE * density.deviation, low, high)
        middles = first + (last - first) * (np.arange(_SLABS) + 0.5) / _SLABS  # (square, slab)
        # Every square has the same number of slabs, but their width differs between squares. The probability of a slab
        # is the density at its centre times its width, up to a constant.
        log_probability = density.log_density(middles) + np.log(last - first)
        probability = np.exp(log_probability - log_probability.max())
        return _Slabs(centres, n_along_side, first, last, probability)
