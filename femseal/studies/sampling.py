"""Describe the seals of the stochastic study, and compute the nominal pressure of their tiles.

The pressure of a tile follows from the pressure map. Fluid pressure that acts on the surfaces reduces it.
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
#: Largest number of tiles that are solved of a seal that does not vary along its length. A longer seal is represented
#: by a part of it. The leakage of such a part scatters by less than 1 %, except near closing.
MOST_TILES = 4000
#: Largest number of pressure paths on which every cell is interpolated, under one map and under several maps at
#: different loads. If there are more paths, similar ones are merged, see `distinct_paths`.
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
    """Hold the options of the seals of the stochastic study.

    Parameters
    ----------
    length : float or None, m
        Length of a straight seal along x2, which is rounded to whole tiles. None if the layout defines the size of the
        seal.
    realisations : int, optional
        Number of realisations. By default as many are solved as the 95 % interval needs, see `stochastic`.
    seed : int
        Seed of all random numbers.
    breadth : float, optional, m
        Breadth of a straight seal from inlet to outlet. The default is the breadth of the surface.
    pressure_map : optional
        Contact pressure over the seal, as a fraction of the nominal pressure, see `seal.pressure_map`.
    form : optional
        Form of the whole seal, from which the pressure of its tiles is computed. It is a form of `seal.form`, a seat
        such as `CrownedSeat`, or several of them, whose heights are added.
    median_fields : bool
        Whether to keep the fields of the realisation whose leakage is nearest to the median.

    Raises
    ------
    InputError
        The number of realisations is below 1, the seed is not a whole number >= 0, the length or breadth is not above
        0, or both a pressure map and a form are given.

    Examples
    --------
    >>> Sampling(0.1, seed=1, breadth=2e-3).presses_evenly  # 0.1 m long, 2 mm broad
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

    The cells stay in order if the seal is as broad as the surface and all of its tiles have the same pressure.

    cells : numbers of cells along x1 and x2. None chooses numbers that suit the seal, see `usual_cells`.

    Raises InputError for cells that are too small, and for the reasons of `seal.layouts.Layout.lay_out`.
    """
    presses_evenly = sampling.presses_evenly
    most_tiles = MOST_TILES if presses_evenly else None

    def cut_and_lay_out(in_order: bool) -> tuple[Cut, SealTiles]:
        cut = Cut.of(surface, cells or usual_cells(surface, in_order=in_order))
        cell_size = CellSize(cut.size, cut.shape[0], sampling.length, sampling.breadth, most_tiles)
        tiles = layout.lay_out(cell_size)
        return cut, replace(tiles, in_order=tiles.in_order and presses_evenly)

    # The usual number of cells depends on whether they stay in order. This is only known when the tiles are laid out.
    # First assume that the cells stay in order, and cut the surface again if they do not.
    cut, tiles = cut_and_lay_out(in_order=True)
    if cells or tiles.in_order:
        return cut, tiles
    return cut_and_lay_out(in_order=False)


def seal_for_maps(layout: Layout, tiles: SealTiles) -> PressedSeal:
    """Return the seal in the coordinates in which pressure maps are given."""
    return PressedSeal(layout.frame(tiles.size), tiles.outlines[tiles.unrepeated_elements])


def pressure_fractions(scene: Scene, tiles: SealTiles, pressure_map: AnyMap) -> Array:
    """Return the pressure of each tile under a pressure map, as a fraction of the nominal pressure (steps, tiles).

    Raises InputError if the map does not cover the seal.
    """
    if is_uniform(pressure_map):
        return np.broadcast_to(1.0, (len(scene.steps), tiles.count))
    return seal_for_maps(scene.layout, tiles).fractions(
        pressure_map, tiles.middles, scene.steps.pressures
    )


def distinct_paths(fractions: Array) -> tuple[Array, Indices]:
    """Group tiles that have nearly the same pressure at every load step.

    A pressure path contains the pressure of a tile at each load step. If there are too many distinct paths, the cube
    roots of the fractions are rounded to a number of levels, because ln k is nearly linear in the cube root of the
    pressure. The number of levels is reduced until there are no more than `MOST_PATHS` (or `MOST_OF_SEVERAL`) paths.
    Each path is the mean of the tiles that share it. For two maps, the limit of 512 paths changed the leakage by less
    than 3e-4.

    Parameters
    ----------
    fractions : array (steps, tiles)
        Pressure of each tile, as a fraction of the nominal pressure.

    Returns
    -------
    paths : array (steps, paths)
        Distinct pressure paths.
    path_of_tile : array (tiles,)
        Number of the path of each tile.
    """
    differs_by_step = np.ptp(fractions, axis=0).any()
    most_paths = MOST_OF_SEVERAL if differs_by_step else MOST_PATHS
    rounded = fractions  # (step, tile); tiles with equal columns share a path
    levels = float(MOST_PATHS)
    while True:
        _, path_of_tile = np.unique(rounded, axis=1, return_inverse=True)
        path_of_tile = path_of_tile.reshape(-1)
        tiles_of_path = np.bincount(path_of_tile)
        if tiles_of_path.size <= most_paths:
            break
        rounded = np.rint(np.cbrt(fractions / fractions.max()) * (levels - 1))
        levels *= 0.8
    # mean over the tiles of each path, step by step
    sums = (np.bincount(path_of_tile, fractions_at_step) for fractions_at_step in fractions)
    paths = np.array([sums_at_step / tiles_of_path for sums_at_step in sums])
    return paths, path_of_tile


def check_map(scene: Scene, tiles: SealTiles, pressure_map: AnyMap) -> tuple[str, ...]:
    """Check a pressure map before a run, and return warnings.

    Raises InputError if the map does not cover the seal, or if a tile has more pressure than the bodies can carry.
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
    """Return the load for which each pressure field is valid, and the mean of the field over the seal [Pa].

    The load is None for a field that is valid at all loads.
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
    """Warn of pressure fields whose mean is far from the loads."""
    loads = scene.steps.pressures[scene.steps.pressures > 0]
    for load, mean in _field_means(scene, tiles, pressure_map):
        text = f"has the mean {to_text(mean, 'Pa', 3)} over the seal"
        if load is not None and abs(mean - load) > _OFF_LOAD * load:
            yield f"the field of pressure at {to_text(load, 'Pa', 3)} {text}: it is scaled to the load"
        is_far = loads.size and not loads.min() / _FAR_LOAD < mean < loads.max() * _FAR_LOAD
        if load is None and is_far:
            yield f"the field of pressure {text}, far from all loads: is its unit right?"


def describe_map(scene: Scene, tiles: SealTiles, pressure_map: AnyMap) -> str:
    """Describe the range of a pressure map over the seal and the mean of its fields; return "" for a uniform map."""
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
    """Hold the fluid pressures at which the permeabilities of cells are needed.

    Parameters
    ----------
    pressures : tuple of float, Pa
        Fluid pressures.
    piecewise : bool
        How permeabilities are interpolated between these pressures, see `flow.PermeabilityTable`.
    relief : array (pressures,) or (1,), Pa
        How much the fluid reduces the contact pressure of a cell: one value for each of the fluid pressures, or a
        single value if it is the same for all of them.
    """

    pressures: tuple[float, ...]
    piecewise: bool = False
    relief: Array = field(default_factory=partial(np.zeros, 1))

    @classmethod
    def of(cls, scene: Scene) -> TileFluid:
        """Choose the fluid pressures for a scene.

        A flow law that depends on the fluid pressure determines the pressures. Otherwise a single pressure is enough,
        unless the fluid pressure acts on the surfaces and falls from inlet to outlet: then `FLUID_PRESSURES` pressures
        from outlet to inlet are chosen.
        """
        drop, fluid = scene.flow.drop, scene.acting_fluid
        pressures = tuple(drop.pressures)
        piecewise = False
        if fluid is None:
            return cls(pressures)
        if fluid.inlet != fluid.outlet and not drop.law.depends_on_pressure:
            # ln k is a nearly linear function of the cube root of the contact pressure, which is the nominal pressure
            # minus the fluid pressure. The fluid pressures are chosen so that these cube roots are evenly spaced at the
            # lowest load.
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
        """Compute the contact pressures: the nominal pressures minus the reliefs, but at least 0.

        Parameters
        ----------
        paths : array (steps, paths), Pa
            Nominal pressures.

        Returns
        -------
        array (steps, reliefs × paths), Pa
            Contact pressures: first all paths under the first relief, then all paths under the second relief, and so
            on.
        """
        reliefs = self.relief[:, None, None]
        contact_pressures = np.maximum(paths[None] - reliefs, 0.0)  # (relief, step, path)
        return np.concatenate(list(contact_pressures), axis=1)

    def select_matching_reliefs(self, k: Array) -> Array:
        """Select, for each fluid pressure, the permeabilities under the relief that this fluid pressure causes.

        Parameters
        ----------
        k : array (pressures, 2, steps, reliefs × paths, cells), m³
            Permeabilities on the paths of `effective_pressures`, for all combinations of fluid pressure and relief. The
            first axis has length 1 if the flow law does not depend on the pressure.

        Returns
        -------
        array (pressures, 2, steps, paths, cells), m³
            Permeabilities without the axis of the reliefs.
        """
        if self.relief.size == 1:
            return k
        # (fluid pressure, axis, step, relief, path, cell)
        by_relief = k.reshape(*k.shape[:3], self.relief.size, -1, k.shape[-1])
        depends_on_pressure = len(k) > 1
        selected = []
        for n in range(self.relief.size):
            pressure = n if depends_on_pressure else 0
            selected.append(by_relief[pressure, :, :, n])
        return np.array(selected)
