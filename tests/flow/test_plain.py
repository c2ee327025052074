"""The reference implementation of a cell, assembled by scikit-fem, against the fast implementation."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from femseal import InputError, cell_permeability
from femseal.flow import SOLVERS, solve_flow
from femseal.flow.cell import cell_flow, cell_stencil
from femseal.flow.law import CubicLaw
from femseal.flow.plain import assemble_cell

SIDES = ("periodic", "mirror")
SHAPES = ((1, 1), (1, 5), (2, 1), (3, 2), (9, 7), (24, 31), (64, 48))
SPACINGS = ((1e-6, 1e-6), (3e-6, 1e-6), (1e-6, 2.5e-6))


def random_gaps(closed):
    """Log-normal gaps of several shapes and spacings; a fraction of the pixels is in contact."""
    rng = np.random.default_rng([7, round(100 * closed)])
    for number, shape in enumerate(SHAPES):
        gap = 1e-6 * np.exp(0.7 * rng.standard_normal(shape))
        gap[rng.random(shape) < closed] = 0.0
        yield gap, SPACINGS[number % len(SPACINGS)]


@pytest.mark.parametrize("sides", SIDES)
@pytest.mark.parametrize("closed", [0.0, 0.25])
def test_both_paths_assemble_the_same_operator(sides, closed):
    for gap, spacing in random_gaps(closed):
        unit_gap = gap / (gap.max() or 1.0)
        plain = assemble_cell(unit_gap, spacing, sides).toarray()
        fast = cell_stencil(unit_gap, spacing, sides).to_csr().toarray()
        assert_allclose(fast, plain, rtol=0, atol=1e-14 * np.abs(plain).max())


@pytest.mark.parametrize("sides", SIDES)
@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("closed", [0.0, 0.25, 0.35])
def test_all_solvers_find_the_same_permeability(sides, axis, closed):
    for gap, spacing in random_gaps(closed):
        flows = {
            solver: cell_permeability(
                gap, spacing, axis=axis, sides=sides, solver=solver, rtol=1e-10, field_rtol=1e-8
            )
            for solver in SOLVERS
        }
        plain = flows["direct"]
        for flow in flows.values():
            assert_allclose(flow.value, plain.value, rtol=1e-9)
            assert flow.percolates == plain.percolates
            assert_allclose(flow.percolating_fraction, plain.percolating_fraction)
            assert_array_equal(np.isnan(flow.fluid_pressure), np.isnan(plain.fluid_pressure))
            assert_allclose(flow.fluid_pressure, plain.fluid_pressure, atol=1e-6)


@pytest.mark.parametrize("solver", ["amg", "direct"])
def test_the_plain_path_is_exactly_zero_where_a_gap_is_closed(solver):
    gap = np.full((8, 6), 1e-6)
    gap[3] = 0.0
    for axis, percolates in ((0, False), (1, True)):
        flow = cell_permeability(gap, (1e-6, 2e-6), axis=axis, solver=solver)
        assert flow.percolates == percolates
        assert (flow.value > 0) == percolates
    assert cell_permeability(np.zeros((4, 4)), (1e-6, 1e-6), solver=solver).value == 0.0


def test_a_factorisation_is_accurate_for_gaps_of_very_different_size():
    """Sums of conductances of 1 and 1e-21 have lost the narrow links."""
    is_wide = np.random.default_rng(3).random((20, 20)) < 0.5
    gap = np.where(is_wide, 1e-6, 1e-13)
    exact, direct = (
        cell_permeability(gap, (1e-6, 1e-6), solver=solver).value
        for solver in ("elimination", "direct")
    )
    assert_allclose(direct, exact, rtol=1e-9)


@pytest.mark.parametrize("sides", SIDES)
def test_the_plain_path_of_a_uniform_gap_is_the_cubic_law(sides):
    for axis in (0, 1):
        flow = cell_permeability(
            np.full((5, 7), 2e-6), (1e-6, 3e-6), axis=axis, sides=sides, solver="amg"
        )
        assert_allclose(flow.value, (2e-6) ** 3 / 12, rtol=1e-12)
        pressure = flow.fluid_pressure.mean(axis=1 - axis)
        expected = 1 - (np.arange(pressure.size) + 0.5) / pressure.size
        assert_allclose(pressure, expected, rtol=1e-9)


def test_the_plain_path_measures_the_flux_in_the_core_of_a_cell():
    gap = next(gap for gap, _ in random_gaps(0.0) if gap.shape == (24, 31))
    options = {"axis": 0, "sides": "mirror", "rtol": 1e-10, "core": (4, 25)}
    fast = cell_flow(gap, (1e-6, 2e-6), solver="elimination", **options)
    plain = cell_flow(gap, (1e-6, 2e-6), solver="direct", **options)
    assert_allclose(plain.permeability, fast.permeability, rtol=1e-9)
    assert plain.core_ratio != 1.0


class _Tripled(CubicLaw):
    """A law that lets three times as much through."""

    def factor(self, gap, pressure=0.0):
        return 3.0 + 0.0 * np.asarray(gap)


def test_the_plain_path_takes_a_flow_law():
    gap, spacing = next(random_gaps(0.25))
    k = cell_permeability(gap, spacing, law=_Tripled(), solver="amg").value
    assert_allclose(k, 3 * cell_permeability(gap, spacing).value, rtol=1e-9)


def test_a_network_of_links_has_the_solvers_of_the_fast_path_alone():
    stencil = cell_stencil(np.ones((4, 5)), (1.0, 1.0), "periodic")
    with pytest.raises(InputError, match=r"solver: given 'amg', expected one of auto, multigrid"):
        solve_flow(stencil, solver="amg")
