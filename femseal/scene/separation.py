"""Find the contact load of a surface near separation, where the fluid carries nearly the whole nominal pressure.

For a prescribed contact load, the coupled problem of contact and flow always has a solution. The nominal pressure is
the sum of the contact load and the mean pressure of the fluid. As a function of the contact load, the nominal pressure
has a minimum. If the given nominal pressure is less than the minimum, the surfaces separate. If the given nominal
pressure is larger than the minimum, two contact loads give this nominal pressure. The larger contact load is chosen,
because the seal reaches it first when the load is reduced or the fluid pressure is raised.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

#: Contact loads, as fractions of the inlet pressure, between which the smallest nominal pressure is bracketed.
_FIRST_LOADS = np.array([1e-4, 1e-2, 1e-1])
#: Factor between successive contact loads in the search for an upper bracket.
_LOAD_FACTOR = 3.0
#: Relative error of the contact load in the search for the nominal pressure.
_LOAD_RTOL = 1e-4


def find_contact_load(
    nominal_pressure: Callable[[float], float], pressure: float, largest_fluid_pressure: float
) -> tuple[float | None, float]:
    """Find the contact load that gives a nominal pressure, and the smallest nominal pressure of all contact loads [Pa].

    Parameters
    ----------
    nominal_pressure : callable
        Function that solves contact and flow for a contact load [Pa], and returns the nominal pressure [Pa].
    pressure : float
        Nominal pressure [Pa].
    largest_fluid_pressure : float
        Larger absolute value of the fluid pressures at inlet and outlet [Pa].

    Returns
    -------
    load : float or None
        Contact load [Pa]; None if the surfaces separate.
    minimum : float
        Nominal pressure below which the surfaces separate [Pa].
    """
    from scipy.optimize import brentq

    loads = (_FIRST_LOADS * largest_fluid_pressure).tolist()
    load_at_minimum, minimum = _minimum_over_loads(nominal_pressure, loads)
    if pressure <= minimum:
        return None, minimum
    # find the contact load above the minimum that belongs to the nominal pressure
    upper = load_at_minimum
    while nominal_pressure(upper) < pressure:
        upper *= _LOAD_FACTOR
    load = brentq(
        lambda load: nominal_pressure(load) - pressure,
        upper / _LOAD_FACTOR,
        upper,
        rtol=_LOAD_RTOL,
    )
    return load, minimum


def _minimum_over_loads(
    nominal_pressure: Callable[[float], float], loads: list[float]
) -> tuple[float, float]:
    """Find the contact load at which the nominal pressure is smallest; return this load and the nominal pressure [Pa].

    nominal_pressure : function that computes the nominal pressure [Pa] for a contact load [Pa].
    loads : increasing contact loads [Pa], among which the minimum is bracketed.
    """
    from scipy.optimize import minimize_scalar

    nominal_pressures = [nominal_pressure(load) for load in loads]
    lowest = int(np.argmin(nominal_pressures))
    if lowest == 0:
        return loads[0], nominal_pressures[0]
    # search between the neighbours of the best load, on a logarithmic scale
    bracket = np.log([loads[lowest - 1], loads[min(lowest + 1, len(loads) - 1)]])
    optimum = minimize_scalar(
        lambda log_load: nominal_pressure(float(np.exp(log_load))),
        bounds=bracket,
        method="bounded",
        options={"xatol": 0.3},
    )
    return float(np.exp(optimum.x)), float(optimum.fun)
