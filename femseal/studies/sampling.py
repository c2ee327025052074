"""Describe the seals of the stochastic study, and compute the nominal pressure of their tiles.

The nominal pressure of a tile is computed from the pressure map. If the fluid pressure acts on the surfaces, the
contact pressure of a tile is lower than its nominal pressure.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import KW_ONLY, dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np

from ..base import Array, Indices, InputError, Shape, to_text, validate
from ..face.cells import Cut, usual_cells
from ..scene import Scene
from ..seal.form import SealForm
from ..seal.layouts import Layout
from ..seal.pressure_map import AnyMap, MapsAtLoads, PressedSeal, PressureField, Uniform, is_uniform
from ..seal.tiles import CellSize, SealTiles
from ..topography import Surface

#: Smallest and largest number of realisations, if their number is not given.
FEWEST_SEALS, MOST_SEALS = 3, 200
#: Largest number of tiles for a seal that does not vary along its length. A longer seal is represented by a part of its
#: length. The leakage of such a part scatters by less than 1 %, except near closing.
MOST_TILES = 4000
#: Largest number of pressure paths on which every cell is interpolated: first with a single pressure map, then with
#: several pressure maps for different loads. If there are more paths, similar paths are merged, see `distinct_paths`.
MOST_PATHS, MOST_OF_SEVERAL = 512, 4096
#: A warning is given if the mean of a pressure field differs from the load for which it is valid by this fraction.
_OFF_LOAD = 0.1
#: A warning is given if the mean of a pressure field is above the highest or below the lowest load by this factor.
_FAR_LOAD = 10.0
#: Number of fluid pressures at which cells are solved if the fluid pressure acts on the surfaces. Compared with 129
#: fluid pressures, the leakage is within 1.1e-3 for inlet pressures up to 0.3 of the lowest load, and within 9e-3 if
#: the inlet pressure is equal to the lowest load.
FLUID_PRESSURES = 9


@dataclass(frozen=True)
class Sampling:
    """Options of the stochastic study: size of the seal, realisations, and contact pressure over the seal.

    Parameters
    ----------
    length : float or None, m
        Length of a straight seal along x2, which is rounded to whole tiles; None for a seal whose layout defines the
        size, such as a ring.
    realisations : int, optional
        Number of realisations. By default, the stochastic study itself chooses a number that is sufficient for the 95 %
        interval, see `stochastic`.
    seed : int
        Seed of all random numbers.
    breadth : float, optional, m
        Width of a straight seal from inlet to outlet; by default, the width of the surface.
    pressure_map : optional
        Map of the ratio of the contact pressure to the nominal pressure over the seal, see `seal.pressure_map`.
    form : optional
        Form deviation of the whole seal, from which the pressure of each tile is computed: a form of `seal.form`, a
        seat such as `CrownedSeat`, or several forms and seats, whose heights are added.
    median_fields : bool
        Whether the result contains the fields of the realisation whose leakage is nearest to the median leakage.

    Raises
    ------
    InputError
        The number of realisations is below 1, the seed is not a whole number >= 0, the length or breadth is not above
        0, or both a pressure map and a form are given.

    Examples
    --------
    >>> Sampling(0.1, seed=1, breadth=2e-3).presses_evenly  # 0.1 m long, 2 mm wide
    True
    """

    length: float | None
    realisations: int | None = None
    _: KW_ONLY
    seed: int
    breadth: float | None = None
    pressure_map: AnyMap = field(default_factory=Uniform)
    form: tuple[SealForm, ...] = ()
    median_fields: bool = True

    def __post_init__(self) -> None:
        if self.realisations is not None:
            count = validate.count("realisations", self.realisations)
            object.__setattr__(self, "realisations", count)
        object.__setattr__(self, "seed", validate.count("seed", self.seed, least=0))
        forms = self.form if isinstance(self.form, tuple | list) else (self.form,)
        object.__setattr__(self, "form", tuple(forms))
        if self.form and not is_uniform(self.pressure_map):
            raise InputError(
                "form",
                "a form and also a pressure map",
                "either a form or a pressure map, because the form already determines the pressure",
            )
        for name in ("length", "breadth"):
            if getattr(self, name) is not None:
                validate.number(name, getattr(self, name), unit="m")

    @property
    def presses_evenly(self) -> bool:
        """Whether all tiles have the nominal pressure."""
        return is_uniform(self.pressure_map) and not self.form


def cut_and_cover(
    surface: Surface, layout: Layout, cells: Shape | None, sampling: Sampling
) -> tuple[Cut, SealTiles]:
    """Cut a surface into cells along x1 and x2, and cover the seal with tiles that are each as large as a cell.

    The cells stay in order if the seal is as wide as the surface and all tiles have the same pressure.

    cells : numbers of cells along x1 and x2; if None, the usual numbers are chosen, see `usual_cells`.

    Raises InputError if the cells are too small, and in the cases listed in `seal.layouts.Layout.lay_out`.
    """
    presses_evenly = sampling.presses_evenly
    most_tiles = MOST_TILES if presses_evenly else None

    def cut_and_lay_out(in_order: bool) -> tuple[Cut, SealTiles]:
        cut = Cut.of(surface, cells or usual_cells(surface, in_order=in_order))
        cell_size = CellSize(cut.size, cut.shape[0], sampling.length, sampling.breadth, most_tiles)
        tiles = layout.lay_out(cell_size)
        return cut, replace(tiles, in_order=tiles.in_order and presses_evenly)

    # The usual number of cells depends on whether the cells stay in order. The order is only known when the tiles are
    # laid out. First assume that the cells stay in order, and cut the surface again if they do not.
    cut, tiles = cut_and_lay_out(in_order=True)
    if cells or tiles.in_order:
        return cut, tiles
    return cut_and_lay_out(in_order=False)


def usual_realisations(cells: Shape, tiles: SealTiles) -> int:
    """Return the number of realisations with which the median leakage is usually accurate enough.

    The leakage of a seal scatters less if the seal is larger compared with the surface. A large seal therefore needs
    fewer realisations than a small seal.

    cells : numbers of cells of the surface along x1 and x2.
    """
    area_ratio = tiles.count / (cells[0] * cells[1])  # of the seal to the surface
    count = MOST_SEALS / max(area_ratio, 1.0)
    return round(min(max(count, FEWEST_SEALS), MOST_SEALS))


def uses_tabulated_pressures(scene: Scene, sampling: Sampling) -> bool:
    """Return whether a seal with cells at random needs permeabilities at tabulated pressures."""
    return scene.acting_fluid is not None or not sampling.presses_evenly


def seal_for_maps(layout: Layout, tiles: SealTiles) -> PressedSeal:
    """Return the outlines of a seal in the coordinates in which pressure maps are given."""
    return PressedSeal(layout.frame(tiles.size), tiles.outlines[tiles.unrepeated_elements])


def pressure_fractions(scene: Scene, tiles: SealTiles, pressure_map: AnyMap) -> Array:
    """Return the tile pressures under a pressure map, as fractions of the nominal pressure (steps, tiles).

    Raises InputError if the map does not cover the seal.
    """
    if is_uniform(pressure_map):
        return np.broadcast_to(1.0, (len(scene.steps), tiles.count))
    return seal_for_maps(scene.layout, tiles).fractions(
        pressure_map, tiles.middles, scene.steps.pressures
    )


def distinct_paths(fractions: Array) -> tuple[Array, Indices]:
    """Group tiles that have nearly the same pressure at every load step.

    A pressure path is the sequence of the pressures of a tile at all load steps. If there are too many different
    pressure paths, the pressures are rounded, so that similar paths become equal. The cube roots of the pressures are
    rounded to equidistant values, because the logarithm of the permeability is nearly linear in the cube root of the
    pressure. The rounding is made coarser until at most `MOST_PATHS` paths remain (`MOST_OF_SEVERAL` if there are
    several pressure maps for different loads). The pressure of a path is the mean pressure of the tiles that share this
    path. In tests with two pressure maps, the limit of 512 paths changed the leakage by less than 3e-4.

    Parameters
    ----------
    fractions : array (steps, tiles)
        Pressure of each tile, as a fraction of the nominal pressure.

    Returns
    -------
    paths : array (steps, paths)
        Pressures along the distinct paths, as fractions of the nominal pressure.
    path_of_tile : array (tiles,)
        Index of the pressure path of each tile.
    """
    has_several_maps = np.ptp(
        fractions, axis=0
    ).any()  # the fraction of a tile varies with the load step
    most_paths = MOST_OF_SEVERAL if has_several_maps else MOST_PATHS
    rounded = fractions  # (step, tile); tiles with equal columns share a path; not rounded at first
    value_count = float(
        MOST_PATHS
    )  # number of equidistant values to which the cube roots are rounded
    while True:
        _, path_of_tile = np.unique(rounded, axis=1, return_inverse=True)
        path_of_tile = path_of_tile.reshape(-1)
        tiles_of_path = np.bincount(path_of_tile)  # number of tiles on each path
        if tiles_of_path.size <= most_paths:
            break
        rounded = np.rint(np.cbrt(fractions / fractions.max()) * (value_count - 1))
        value_count *= 0.8  # if there are still too many paths, the next pass rounds more coarsely
    # mean over the tiles of each path, step by step
    sums = (np.bincount(path_of_tile, fractions_at_step) for fractions_at_step in fractions)
    paths = np.array([sums_at_step / tiles_of_path for sums_at_step in sums])
    return paths, path_of_tile


def check_map(scene: Scene, tiles: SealTiles, pressure_map: AnyMap) -> tuple[str, ...]:
    """Check a pressure map before a run, and return warnings about implausible pressures.

    Raises InputError if the map does not cover the seal, or if the pressure of a tile is higher than the bodies can
    support.
    """
    if is_uniform(pressure_map):
        return ()
    nominal = scene.steps.pressures
    pressure = nominal[:, None] * pressure_fractions(scene, tiles, pressure_map)  # (step, tile)
    if pressure.max() >= scene.law.capacity:
        step = int(pressure.max(axis=1).argmax())
        given = f"{to_text(float(pressure.max()), 'Pa')} in a tile at {scene.steps[step].name}"
        raise InputError(
            "map", given, f"pressures below the hardness, {to_text(scene.law.capacity, 'Pa')}"
        )
    fluid = scene.acting_fluid
    carried = 0.0  # pressure that the fluid carries
    if fluid is not None and fluid.nominal == "total":
        carried = max(fluid.carried, 0.0)
    warnings = [*_field_warnings(scene, tiles, pressure_map)]
    # fraction of the tiles without contact pressure, at the load step at which it is largest
    without_contact = pressure[nominal > 0] <= carried
    unloaded = float(without_contact.mean(axis=1).max(initial=0.0))
    if unloaded:
        warnings.insert(
            0,
            f"over {unloaded:.0%} of the seal the map presses no more than the fluid carries, "
            f"{to_text(carried, 'Pa', 3)}: tiles just touch there, and a gap that opens is not in the leakage",
        )
    return tuple(warnings)


def _field_means(
    scene: Scene, tiles: SealTiles, pressure_map: AnyMap
) -> list[tuple[float | None, float]]:
    """Return pairs (load, mean pressure over the seal) [Pa] of all pressure fields in a pressure map.

    `load` is the nominal pressure at which the pressure field is valid, or None if it is valid at all loads.
    """
    seal = seal_for_maps(scene.layout, tiles)
    maps_at_loads: Iterable[tuple[float | None, Any]] = [(None, pressure_map)]
    if isinstance(pressure_map, MapsAtLoads):
        maps_at_loads = zip(pressure_map.pressures, pressure_map.maps, strict=True)
    return [
        (load, seal.mean(map_at_load))
        for load, map_at_load in maps_at_loads
        if isinstance(map_at_load, PressureField)
    ]


def _field_warnings(scene: Scene, tiles: SealTiles, pressure_map: AnyMap) -> Iterator[str]:
    """Yield a warning for each pressure field whose mean over the seal is far from the loads."""
    loads = scene.steps.pressures[scene.steps.pressures > 0]
    for load, mean in _field_means(scene, tiles, pressure_map):
        text = f"has the mean {to_text(mean, 'Pa', 3)} over the seal"
        if load is not None and abs(mean - load) > _OFF_LOAD * load:
            yield f"the field of pressure at {to_text(load, 'Pa', 3)} {text}: it is scaled to the load"
        is_far = loads.size and not loads.min() / _FAR_LOAD < mean < loads.max() * _FAR_LOAD
        if load is None and is_far:
            yield f"the field of pressure {text}, far from all loads: is its unit right?"


def describe_map(scene: Scene, tiles: SealTiles, pressure_map: AnyMap) -> str:
    """Describe the range of a pressure map over the seal, and the mean values of its pressure fields.

    The description of a uniform pressure map is "".
    """
    if is_uniform(pressure_map):
        return ""
    fractions = pressure_fractions(scene, tiles, pressure_map)
    text = f"{fractions.min():.3g} to {fractions.max():.3g} of the nominal pressure over the seal"
    means = [to_text(mean, "Pa", 3) for _, mean in _field_means(scene, tiles, pressure_map)]
    if means:
        text += f"; mean of the field {' and '.join(means)}, scaled to every load"
    return text


@dataclass(frozen=True, eq=False)
class TileFluid:
    """Fluid pressures at which the permeabilities of cells are needed.

    Parameters
    ----------
    pressures : tuple of float, Pa
        Fluid pressures.
    piecewise : bool
        How permeabilities are interpolated between the fluid pressures, see `flow.PermeabilityTable`.
    relief : array (pressures,) or (1,), Pa
        Relief: reduction of the contact pressure of a cell by the fluid. The array contains one relief for each fluid
        pressure, or a single relief that is valid at all fluid pressures.
    """

    pressures: tuple[float, ...]
    piecewise: bool = False
    relief: Array = field(default_factory=partial(np.zeros, 1))

    @classmethod
    def of(cls, scene: Scene) -> TileFluid:
        """Choose the fluid pressures at which the cells of a scene are computed.

        The fluid pressures are chosen as follows:

        - If the flow law depends on the fluid pressure, the fluid pressures of the flow law are used.
        - If the fluid pressure acts on the surfaces and falls from inlet to outlet, `FLUID_PRESSURES` values between
          the outlet and the inlet pressure are used.
        - In all other cases, a single fluid pressure is sufficient.
        """
        drop, fluid = scene.flow.drop, scene.acting_fluid
        pressures = tuple(drop.pressures)
        piecewise = False
        if fluid is None:
            return cls(pressures)
        if fluid.inlet != fluid.outlet and not drop.law.depends_on_pressure:
            # ln k is a nearly linear function of the cube root of the contact pressure, which is the nominal pressure
            # minus the fluid pressure. The fluid pressures are chosen so that the cube roots of the contact pressures
            # are evenly spaced at the lowest load.
            lowest_load = min((p for p in scene.steps.pressures if p > 0), default=0.0)
            nominal = max(lowest_load, fluid.inlet, fluid.outlet)
            root_at_outlet = float(np.cbrt(nominal - fluid.outlet))
            root_at_inlet = float(np.cbrt(nominal - fluid.inlet))
            roots = np.linspace(root_at_outlet, root_at_inlet, FLUID_PRESSURES)
            between = nominal - roots[1:-1] ** 3
            pressures = (fluid.outlet, *between.tolist(), fluid.inlet)
            piecewise = True
        relief = fluid.relief(pressures if len(pressures) > 1 else [fluid.mean])
        return cls(pressures, piecewise, relief)

    def effective_pressures(self, paths: Array) -> Array:
        """Compute the contact pressures of all paths under all reliefs: nominal pressure minus relief, but at least 0.

        Parameters
        ----------
        paths : array (steps, paths), Pa
            Nominal pressures of the pressure paths.

        Returns
        -------
        array (steps, reliefs × paths), Pa
            Contact pressures. The second axis contains first all paths under the first relief, then all paths under the
            second relief, and so on.
        """
        reliefs = self.relief[:, None, None]
        contact_pressures = np.maximum(paths[None] - reliefs, 0.0)  # (relief, step, path)
        return np.concatenate(list(contact_pressures), axis=1)

    def select_matching_reliefs(self, k: Array) -> Array:
        """Select, for each fluid pressure, the permeabilities computed with the relief by that fluid pressure.

        Parameters
        ----------
        k : array (pressures, 2, steps, reliefs × paths, cells), m³
            Permeabilities on the paths that `effective_pressures` returns, for all combinations of fluid pressure and
            relief. The axis of the fluid pressures has length 1 if the flow law does not depend on the fluid pressure.

        Returns
        -------
        array (pressures, 2, steps, paths, cells), m³
            Permeabilities on the nominal pressure paths, each with the relief for the fluid pressure on the first axis.
        """
        if self.relief.size == 1:
            return k
        # (fluid pressure, axis, step, relief, path, cell)
        by_relief = k.reshape(*k.shape[:3], self.relief.size, -1, k.shape[-1])
        # fluid pressure n causes relief n, so that both indices are n, unless the first axis has length 1
        depends_on_pressure = len(k) > 1
        selected = []
        for n_relief in range(self.relief.size):
            n_pressure = n_relief if depends_on_pressure else 0
            selected.append(by_relief[n_pressure, :, :, n_relief])
        return np.array(selected)
