"""Permeability of one drawn seal, and the seal whose leakage is nearest to the median, with its fields."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..base.text import Shown
from ..flow.gas_drop import GasDrop
from ..flow.permeability_table import PermeabilityTable
from ..scales import Failed, attempt, draw_links, draw_pressures
from ..scales.sampling import Index
from ..seal import RectangularSeal
from ..seal.layouts import SealWindows
from ..seal.linked import LinkWindows
from .sampling_options import Sampling
from .scene import Array, Scene, labels
from .sources import Tables

#: Values of one field, parts times load steps, above which no fields are kept.
MOST_VALUES = 4_000_000
#: Leakages below this share of the first one do not choose the median.
_FLOOR = 1e-3


@dataclass(frozen=True, repr=False)
class MedianSeal(Shown):
    """Fields of the realisation whose leakage is nearest to the median, over the parts of the seal.

    realisation : its number.
    outlines : corners of the parts (parts, corners, 2) [m]. permeability, fluid_pressure : (steps, parts), NaN at steps
        that failed, and the fluid pressure also in pockets.
    flux : volume rate per width at the fluid's reference density, in the plane of the seal (steps, parts, 2).
    pressure : mean contact pressure of the windows of every part (steps, parts).
    """

    realisation: int
    outlines: Array = field(repr=False, metadata=labels("m", "corners of the parts of the seal"))
    permeability: Array = field(metadata=labels("m^3", "permeability, median realisation", "step", "part"))
    fluid_pressure: Array = field(metadata=labels("Pa", "fluid pressure, median realisation", "step", "part"))
    flux: Array = field(metadata=labels("m^2/s", "flow per width, median realisation", "step", "part", "plane"))
    pressure: Array | None = field(
        default=None,
        metadata=labels(
            "Pa", "contact pressure of windows, median realisation", "step", "part", name="window_pressure"
        ),
    )


def median_of_runs(
    realisation: int, *, scene: Scene, seal: RectangularSeal, columns: Index, states: Sequence[Any], pressure: Array
) -> MedianSeal:
    """Fields of a chain of runs: those of the uncut face at its columns.

    Parameters
    ----------
    seal : with a window for each part. columns : of the face, in the order of the seal.
    states : `StateRuns` of every step, or a failure. pressure : contact pressure of the windows (steps, m1, m2) [Pa].
    """
    outlines = LinkWindows(seal).outlines
    k, p, flux = (np.full((len(states), len(outlines), *plane), np.nan) for plane in ((), (), (2,)))
    inlet, outlet = scene.fluid.potential([scene.inlet_pressure, scene.outlet_pressure])
    drop = (inlet - outlet) / scene.fluid.reference_density
    (l1, l2), (n1, n2) = seal.size, seal.cells
    widths = np.array([l2 / n2, l1 / n1])
    for s, state in enumerate(states):
        if not isinstance(state, Failed):
            k[s], p[s] = state.k[:, columns].ravel(), scene.pressure_at(np.clip(state.share[:, columns], 0, 1)).ravel()
            flux[s] = drop * state.flow[:, :, columns].reshape(2, -1).T / widths
    return MedianSeal(realisation, outlines, k, p, flux, pressure[:, :, columns].reshape(len(states), -1))


def drawn_permeability(
    laid: SealWindows, kinds: tuple[Tables, ...], sampling: Sampling, realisation: int, drop: GasDrop | None
) -> Callable[[int], Any]:
    """Permeability of a realisation at a step, as `seal_leakage` takes it.

    kinds : tables of the windows; of a gas with slip one for each pressure of its `drop`.
    """
    sampler, seed = sampling.sampler_of_links, sampling.seed
    draws = [
        [
            # windows whose two values belong together are drawn with the same random numbers
            draw_links(t, sampler=sampler, seed=seed, realisation=realisation, axis=0 if laid.together else axis)
            for axis, t in enumerate(tables)
        ]
        for tables in kinds
    ]
    return lambda s: PermeabilityTable.of(drop, [laid.permeability(along(s), across(s)) for along, across in draws])


def nearest_to_median(leakage: Array) -> int | None:
    """Realisation whose ln(leakage) (realisations, steps) is nearest to the median of all; None where none leaks."""
    size = np.abs(leakage)
    whole = np.isfinite(size).all(axis=1)
    if not whole.any():
        return None
    median = np.median(size[whole], axis=0)
    chosen = np.asarray(median > _FLOOR * median.max())
    if not chosen.any():
        return None
    with np.errstate(divide="ignore"):
        distance = np.abs(np.log(size[:, chosen] / median[chosen])).mean(axis=1)
    return int(np.argmin(np.where(np.isnan(distance), np.inf, distance)))


def median_seal(
    realisation: int, *, scene: Scene, laid: SealWindows, kinds: tuple[Tables, ...], sampling: Sampling
) -> MedianSeal:
    """Draw a realisation again and solve its flow at every step; kinds as in `drawn_permeability`."""
    permeability = drawn_permeability(laid, kinds, sampling, realisation, scene.flow.drop)
    outlines = laid.outlines
    k, p, flux = (np.full((len(scene.steps), len(outlines), *plane), np.nan) for plane in ((), (), (2,)))
    for s in range(len(scene.steps)):
        given = permeability(s)
        found = attempt(scene.leakage, laid.seal, given)
        if not isinstance(found, Failed):
            at_solution = given if found.permeability is None else found.permeability
            k[s], p[s] = laid.shown(at_solution, found.fluid_pressure)
            potential = scene.fluid.potential(found.fluid_pressure) / scene.fluid.reference_density
            flux[s] = laid.flux(at_solution, potential, found.volume_rate)
    sampler, seed = sampling.sampler_of_links, sampling.seed
    pressure = draw_pressures(kinds[0][0], sampler=sampler, seed=seed, realisation=realisation, axis=0)
    of_windows = None if pressure is None else np.array([laid.means(pressure(s)) for s in range(len(scene.steps))])
    return MedianSeal(realisation, outlines, k, p, flux, of_windows)
