"""Permeability of one drawn seal, and the seal whose leakage is nearest to the median, with its fields."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..base.arrays import Array
from ..base.fields import CORNER, PART, PART_VECTOR, declared
from ..base.text import Shown
from ..library import draw_links, draw_pressures
from ..seal import Leakage, RectangularSeal
from ..seal.laid_windows import SealWindows
from ..seal.link_windows import LinkWindows
from ..windows import Failed, Partition, attempt
from .run_chains import ChainedSeals, StateRuns
from .sampling_options import Sampling
from .scene import Scene
from .window_supply import TablePressures, Tables

#: Values of one field, parts times load steps, above which no fields are kept.
MOST_VALUES = 4_000_000
#: Relative error, as estimated, at which the leakage of a drawn seal has settled where permeabilities depend on the
#: pressure; it was within 1e-3 up to a fluid pressure of .95 of the load. Realisations differ by a percent.
DRAWN_RTOL = 3e-4
#: The same where the library is drawn again, whose error is several percent.
RESAMPLED_RTOL = 3e-3
#: Leakages below this fraction of the first one do not choose the median.
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
    outlines: Array = declared(
        "drawn_corners", "m", "corners of the parts of the drawn seal, in its plane", CORNER, repr=False
    )
    permeability: Array = declared("drawn_permeability", "m^3", "permeability, median realisation", PART)
    fluid_pressure: Array = declared(
        "drawn_fluid_pressure", "Pa", "fluid pressure, median realisation", PART, in_si=True
    )
    flux: Array = declared("drawn_flux", "m^2/s", "flow per width, median realisation", PART_VECTOR)
    pressure: Array | None = declared(
        "drawn_window_pressure", "Pa", "contact pressure of windows, median realisation", PART, default=None
    )


def drawn_permeability(
    seal_windows: SealWindows, kinds: tuple[Tables, ...], sampling: Sampling, realisation: int, at: TablePressures
) -> Callable[[int], Any]:
    """Permeability of a realisation at a step, as `seal_leakage` takes it.

    kinds : tables of the windows, one for each of the pressures.
    """
    sampler, seed = sampling.sampler_of_links, sampling.seed
    draws = [
        [
            # windows whose two values belong together are drawn with the same random numbers
            draw_links(
                t, sampler=sampler, seed=seed, realisation=realisation, axis=0 if seal_windows.together else axis
            )
            for axis, t in enumerate(tables)
        ]
        for tables in kinds
    ]
    return lambda s: at.table([seal_windows.permeability(along(s), across(s)) for along, across in draws])


def nearest_to_median(leakage: Array) -> int | None:
    """Realisation whose ln(leakage) (realisations, steps) is nearest to the median of all; None where none leaks.

    Steps at which all failed do not count.
    """
    size = np.abs(leakage[:, np.isfinite(leakage).any(axis=0)])
    whole = np.isfinite(size).all(axis=1)
    if not size.size or not whole.any():
        return None
    median = np.median(size[whole], axis=0)
    chosen = np.asarray(median > _FLOOR * median.max())
    if not chosen.any():
        return None
    with np.errstate(divide="ignore"):
        distance = np.abs(np.log(size[:, chosen] / median[chosen])).mean(axis=1)
    return int(np.argmin(np.where(np.isnan(distance), np.inf, distance)))


def median_seal(
    realisation: int,
    *,
    scene: Scene,
    seal_windows: SealWindows,
    kinds: tuple[Tables, ...],
    sampling: Sampling,
    at: TablePressures,
) -> MedianSeal:
    """Draw a realisation again and solve its flow at every step; kinds as in `drawn_permeability`."""
    permeability = drawn_permeability(seal_windows, kinds, sampling, realisation, at)
    outlines = seal_windows.outlines
    k, p, flux = (np.full((len(scene.steps), len(outlines), *plane), np.nan) for plane in ((), (), (2,)))
    for s in range(len(scene.steps)):
        given = permeability(s)
        found = attempt(scene.leakage, seal_windows.seal, given, DRAWN_RTOL)
        if not isinstance(found, Failed):
            at_solution = given if found.permeability is None else found.permeability
            k[s], p[s] = seal_windows.shown(at_solution, found.fluid_pressure)
            potential = scene.fluid.potential(found.fluid_pressure) / scene.fluid.reference_density
            flux[s] = seal_windows.flux(at_solution, potential, _rate_of_power(scene, seal_windows.seal, found))
    sampler, seed = sampling.sampler_of_links, sampling.seed
    pressure = draw_pressures(kinds[0][0], sampler=sampler, seed=seed, realisation=realisation, axis=0)
    of_windows = None
    if pressure is not None:
        of_windows = np.array([seal_windows.means(pressure(s)) for s in range(len(scene.steps))])
        if (fluid := scene.acting_fluid) is not None and at.piecewise:
            of_windows = np.maximum(of_windows - np.nan_to_num(fluid.relief(p)), 0.0)
    return MedianSeal(realisation, outlines, k, p, flux, of_windows)


def _rate_of_power(scene: Scene, seal: Any, found: Leakage) -> float:
    """Leakage [m³/s] that dissipates as much over the highest drop as the flow between all boundaries does."""
    if found.boundary_rates is None:
        return found.volume_rate
    ends = seal.boundaries
    drops = scene.fluid.potential(ends.pressures) - scene.fluid.potential(scene.outlet_pressure)
    rates = [found.boundary_rates[name] for name in ends.names[: len(drops)]]
    return float(drops @ rates / np.abs(drops).max())


def median_chain(
    realisation: int,
    *,
    scene: Scene,
    partition: Partition,
    drawn: ChainedSeals,
    states: Sequence[StateRuns | Failed],
    pressure: Array,
) -> MedianSeal:
    """Fields of a chain of runs, whose windows have those that they have in the uncut face.

    The flux through every row of windows is scaled so that it carries the leakage of the chain.

    drawn : chains, of which this is one. states : `StateRuns` of every step, or `Failed`.
    pressure : mean contact pressure of the windows of the face (steps, m1, m2) [Pa].
    """
    (m1, m2), (d1, d2) = partition.cells, partition.window_size
    columns = drawn.windows(realisation, m2)
    outlines = LinkWindows(RectangularSeal((m1 * d1, columns.size * d2), (m1, columns.size))).outlines
    k, p, flux = (np.full((len(states), len(outlines), *plane), np.nan) for plane in ((), (), (2,)))
    for s, state in enumerate(states):
        if isinstance(state, Failed):
            continue
        k[s] = state.k[:, columns].ravel()
        p[s] = scene.pressure_at(state.potential[:, columns]).ravel()
        through = state.flux[:, columns]
        total = through[..., 0].mean(axis=1)
        scale = np.divide(drawn.leakage[realisation, s], total, out=np.zeros(m1), where=total > 0)
        flux[s] = (scale[:, None, None] * through).reshape(-1, 2)
    return MedianSeal(realisation, outlines, k, p, flux, pressure[:, :, columns].reshape(len(states), -1))
