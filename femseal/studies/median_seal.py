"""Compute fields over the elements of the seal, for the realisation whose leakage is nearest to the median."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from ..base import Array, Mapper, Shown, Stage
from ..base.fields import CORNER, TILE, TILE_FORM, TILE_VECTOR, declared
from ..face.cell_flow import Failed
from ..loads import FLOOR
from ..seal.tiles import SealTiles
from .cell_supply import CellSupply
from .sampling import Sampling
from .seal_contact import SealContact

#: Largest number of values (elements times load steps) for which the fields of the median realisation are stored.
MOST_VALUES = 4_000_000


@dataclass(frozen=True, repr=False)
class MedianSeal(Shown):
    """Fields, over the elements of the seal, of the realisation whose leakage is nearest to the median.

    Parameters
    ----------
    realisation : int
        Number of the realisation.
    outlines : array (elements, corners, 2), m
        Corners of the elements in the plane of the seal.
    permeability : array (steps, elements), m³
        Permeability of each element, NaN at load steps at which the flow solver failed.
    fluid_pressure : array (steps, elements), Pa
        Fluid pressure; NaN in pockets without a connection to inlet or outlet, and at load steps at which the flow
        solver failed.
    flux : array (steps, elements, 2), m²/s
        Volume flow rate per unit width at the reference density of the fluid, as a vector in the plane of the seal.
    pressure : array (steps, elements), Pa
        Mean contact pressure of the tile to which each element belongs.
    form : array (elements,), m, optional
        Height of the form deviation of the seal; None for a seal without form deviation.
    separation : array (steps, elements), m, optional
        Distance between the mean planes of the two faces; None for a seal without form deviation.
    nominal : array (steps, elements), Pa, optional
        Nominal pressure of the tiles due to the form deviation of the seal; None for a seal without form deviation.
    """

    realisation: int
    outlines: Array = declared(
        "drawn_corners",
        "m",
        "corners of the elements of the seal, in its plane",
        CORNER,
        repr=False,
    )
    permeability: Array = declared(
        "drawn_permeability", "m^3", "permeability, median realisation", TILE
    )
    fluid_pressure: Array = declared(
        "drawn_fluid_pressure", "Pa", "fluid pressure, median realisation", TILE
    )
    flux: Array = declared("drawn_flux", "m^2/s", "flow per width, median realisation", TILE_VECTOR)
    pressure: Array | None = declared(
        "drawn_contact_pressure",
        "Pa",
        "contact pressure of tiles, median realisation",
        TILE,
        default=None,
    )
    form: Array | None = declared("drawn_form", "m", "form of the seal", TILE_FORM, default=None)
    separation: Array | None = declared(
        "drawn_separation", "m", "distance of the mean planes of the faces", TILE, default=None
    )
    nominal: Array | None = declared(
        "drawn_nominal_pressure",
        "Pa",
        "nominal pressure of tiles under the form of the seal",
        TILE,
        default=None,
    )


def solve_median_seal(
    supply: CellSupply,
    sampling: Sampling,
    leakage: Array,
    contact: SealContact | None,
    mapper: Mapper,
) -> MedianSeal | None:
    """Compute the fields of the realisation whose leakage is nearest to the median.

    None is returned in three cases: the options exclude the fields, the fields are too large, or the median realisation
    is not defined (see `find_median_realisation`).
    """
    value_count = len(supply.tiles.outlines) * len(supply.scene.steps)
    if not sampling.median_fields or value_count > MOST_VALUES:
        return None
    realisation = find_median_realisation(leakage)
    if realisation is None:
        return None
    solve = partial(_fields_of_realisation, supply=supply, seed=sampling.seed)
    (median_seal,) = mapper(Stage("median seal", solve), [realisation])
    if contact is None:
        return median_seal
    return _with_form(median_seal, supply.tiles, contact)


def _fields_of_realisation(realisation: int, *, supply: CellSupply, seed: int) -> MedianSeal:
    """Solve a realisation again, and return its fields over the elements of the seal."""
    scene, tiles = supply.scene, supply.tiles
    cell_of_tile = supply.choose_cells(seed, realisation)
    shape = len(scene.steps), len(tiles.outlines)  # (step, element)
    k = np.full(shape, np.nan)
    fluid_pressure = np.full(shape, np.nan)
    flux = np.full((*shape, 2), np.nan)
    for s in supply.solved_steps:
        permeability, flow = supply.solve_flow(cell_of_tile, s)
        if isinstance(flow, Failed):
            continue
        if flow.permeability is not None:
            # if the permeability depends on the fluid pressure, `flow` contains the permeability at the solved fluid
            # pressures
            permeability = flow.permeability
        k[s], fluid_pressure[s] = tiles.element_means(permeability, flow.fluid_pressure)
        potential = scene.fluid.potential(flow.fluid_pressure) / scene.fluid.reference_density
        flux[s] = tiles.flux(permeability, potential, flow.volume_rate)
    # mean contact pressure of the tile to which each element belongs (step, element)
    if tiles.in_order:
        # the contact of each cell was solved at the load steps
        cell_pressure = supply.cells.pressure.reshape(len(scene.steps), -1)  # (step, cell)
        pressure = cell_pressure[:, cell_of_tile[tiles.tile]]
    else:
        # nominal pressure of the tile, minus the pressure that the fluid carries
        pressure = supply.paths[:, supply.path_of_tile[tiles.tile]]
        fluid = scene.acting_fluid
        if fluid is not None:
            relief = np.nan_to_num(fluid.relief(fluid_pressure))
            pressure = np.maximum(pressure - relief, 0.0)
    elements = tiles.unrepeated_elements
    return MedianSeal(
        realisation=realisation,
        outlines=tiles.outlines[elements],
        permeability=k[:, elements],
        fluid_pressure=fluid_pressure[:, elements],
        flux=flux[:, elements],
        pressure=pressure[:, elements],
    )


def _with_form(median_seal: MedianSeal, tiles: SealTiles, contact: SealContact) -> MedianSeal:
    """Add the form deviation of the seal, and the resulting contact, to the fields of the median realisation."""
    tile_of_element = tiles.tile[tiles.unrepeated_elements]

    def over_elements(values: Array) -> Array:
        return contact.grid.means(values)[..., tile_of_element]

    return replace(
        median_seal,
        form=over_elements(-contact.depth),
        separation=over_elements(contact.separation),
        nominal=over_elements(contact.pressure),
    )


def find_median_realisation(leakage: Array) -> int | None:
    """Return the number of the median realisation, whose leakage is nearest to the median leakage.

    The distance of a realisation from the median is the mean of |ln(leakage/median leakage)| over the load steps. Load
    steps at which all realisations failed, or at which the median leakage is negligible, are excluded from the mean.
    None is returned if all realisations are sealed, or if each of them failed at some load step at which others were
    solved.

    leakage : leakage of each realisation at each load step (realisations, steps).
    """
    # steps at which at least one realisation was solved
    solved_steps = np.isfinite(leakage).any(axis=0)
    magnitude = np.abs(leakage[:, solved_steps])  # (realisation, step)
    # realisations that were solved at all of these steps
    is_complete = np.isfinite(magnitude).all(axis=1)
    if not magnitude.size or not is_complete.any():
        return None
    median = np.median(magnitude[is_complete], axis=0)
    leaks = median > FLOOR * median.max()  # steps at which the median leakage is not negligible
    if not leaks.any():
        return None
    with np.errstate(divide="ignore"):
        distance = np.abs(np.log(magnitude[:, leaks] / median[leaks])).mean(axis=1)
    # the distance is NaN for a realisation that failed at one of the steps
    return int(np.argmin(np.where(np.isnan(distance), np.inf, distance)))
