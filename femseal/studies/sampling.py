"""Describe the seal of the stochastic study, and the pressure of its tiles: under a map, less the fluid pressure."""

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

#: Fewest and most realisations, where their number is not given.
FEWEST_SEALS, MOST_SEALS = 3, 200
#: Of a seal with more tiles, which is alike all along, only a part with so many tiles is solved: the leakage of such a
#: part scatters by less than 1 %, except near closing.
MOST_TILES = 4000
#: Most pressure paths along which every cell is interpolated, under one map and under several maps at different loads.
#: More paths are rounded, see `distinct_paths`.
MOST_PATHS, MOST_OF_SEVERAL = 512, 4096
#: A warning says so if the mean of a pressure field differs from the load at which it holds by this fraction.
_OFF_LOAD = 0.1
#: A warning says so if the mean of a pressure field is this many times above the highest or below the lowest load.
_FAR_LOAD = 10.0
#: Number of fluid pressures at which cells are solved that the fluid presses apart. Compared with 129 pressures, the
#: leakage is within 1.1e-3 for inlet pressures up to 0.3 of the lowest load, and within 9e-3 where both are equal.
FLUID_PRESSURES = 9


@dataclass(frozen=True)
class Sampling:
    """Options of the seals of the stochastic study.

    Parameters
    ----------
    length : of a straight seal along x2, m, rounded to whole tiles; None where the layout has its own size.
    realisations : number of seals; None solves as many as the interval needs, see `stochastic`.
    seed : of all random numbers.
    breadth : of a straight seal from inlet to outlet, m; None is that of the surface.
    pressure_map : contact pressure over the seal in fractions of the nominal pressure, see `seal.pressure_map`.
    form : of the whole seal, which then gives the pressure of its tiles: a form of `seal.form`, or a seat such as
        `CrownedSeat`; forms of both bodies add up.
    median_fields : whether to keep the fields of the seal whose leakage is nearest to the median.

    Raises
    ------
    InputError : a number of realisations below 1; a seed that is not a whole number from 0; a length or breadth that is
        not above 0; both a map and a form.

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
        given = self.form if isinstance(self.form, tuple | list) else (self.form,)
        object.__setattr__(self, "form", tuple(given))
        if self.form and not is_uniform(self.pressure_map):
            raise InputError(
                "form", "a form and a map of the pressure", "one of them: a form gives the pressure"
            )
        for name in ("length", "breadth"):
            if getattr(self, name) is not None:
                validate.number(name, getattr(self, name), unit="m")

    @property
    def presses_evenly(self) -> bool:
        """Whether all tiles have the nominal pressure."""
        return is_uniform(self.pressure_map) and not self.form


def laid_out(
    surface: Surface, layout: Layout, cells: Shape | None, sampling: Sampling
) -> tuple[Cut, SealTiles]:
    """Cut a surface into cells along x1 and x2, and cover the seal with tiles that are each as large as a cell.

    Cells stay in order where the seal is as broad as the surface and is pressed evenly.

    cells : numbers of cells; None: as many as suit the seal, see `usual_cells`.

    Raises InputError: cells that are too small; see `seal.layouts.Layout.lay_out`.
    """
    even = sampling.presses_evenly
    most = MOST_TILES if even else None
    for in_order in (True, False):
        cut = Cut.of(surface, cells or usual_cells(surface, in_order=in_order))
        tiles = layout.lay_out(
            CellSize(cut.size, cut.shape[0], sampling.length, sampling.breadth, most)
        )
        tiles = replace(tiles, in_order=tiles.in_order and even)
        if cells or tiles.in_order:
            break
    return cut, tiles


def seal_for_maps(layout: Layout, tiles: SealTiles) -> PressedSeal:
    """Return the seal in the coordinates of pressure maps."""
    return PressedSeal(layout.frame(tiles.size), tiles.outlines[tiles.once])


def pressure_fractions(scene: Scene, tiles: SealTiles, pressure_map: AnyMap) -> Array:
    """Return the pressure of the tiles in fractions of the nominal pressure (steps, tiles).

    Raises InputError: the map does not cover the seal.
    """
    if is_uniform(pressure_map):
        return np.broadcast_to(1.0, (len(scene.steps), tiles.count))
    return seal_for_maps(scene.layout, tiles).fractions(
        pressure_map, tiles.middles, scene.steps.pressures
    )


def distinct_paths(fractions: Array) -> tuple[Array, Indices]:
    """Find the distinct pressure paths (steps, paths) of fractions (steps, n), and the path number of each (n,).

    If there are more than `MOST_PATHS`, or `MOST_OF_SEVERAL`, the fractions are rounded in their cube root, in which ln
    k is nearly straight, to steps of 1/512 of the largest or more. A path is the mean of the fractions that share it.
    Under two maps with 512 paths the leakage changed by less than 3e-4.
    """
    most = MOST_OF_SEVERAL if np.ptp(fractions, axis=0).any() else MOST_PATHS
    keys, levels = fractions, float(MOST_PATHS)
    while True:
        _, number = np.unique(keys, axis=1, return_inverse=True)
        number = number.reshape(-1)
        members = np.bincount(number)
        if members.size <= most:
            return np.array([np.bincount(number, row) / members for row in fractions]), number
        keys = np.rint(np.cbrt(fractions / fractions.max()) * (levels - 1))
        levels *= 0.8


def check_map(scene: Scene, tiles: SealTiles, pressure_map: AnyMap) -> tuple[str, ...]:
    """Check a pressure map before a run, and return warnings.

    Raises InputError: the map does not cover the seal, or a tile has more pressure than the bodies can carry.
    """
    if is_uniform(pressure_map):
        return ()
    nominal = scene.steps.pressures
    pressure = nominal[:, None] * pressure_fractions(scene, tiles, pressure_map)
    if pressure.max() >= scene.law.capacity:
        step = int(pressure.max(axis=1).argmax())
        given = f"{to_text(float(pressure.max()), 'Pa')} in a tile at {scene.steps[step].name}"
        raise InputError(
            "map", given, f"pressures below the hardness, {to_text(scene.law.capacity, 'Pa')}"
        )
    fluid = scene.acting_fluid
    carried = max(fluid.carried, 0.0) if fluid is not None and fluid.nominal == "total" else 0.0
    touching = float((pressure[nominal > 0] <= carried).mean(axis=1).max(initial=0.0))
    bare = (
        f"over {touching:.0%} of the seal the map presses no more than the fluid carries, {to_text(carried, 'Pa', 3)}: "
        "tiles just touch there, and a gap that opens is not in the leakage",
    )
    return (*(bare if touching else ()), *_field_warnings(scene, tiles, pressure_map))


def _field_means(
    scene: Scene, tiles: SealTiles, pressure_map: AnyMap
) -> list[tuple[float | None, float]]:
    """Return the load of every pressure field, None for all loads, and its mean over the seal [Pa]."""
    seal = seal_for_maps(scene.layout, tiles)
    each: Iterable[tuple[float | None, Any]] = [(None, pressure_map)]
    if isinstance(pressure_map, MapsAtLoads):
        each = zip(pressure_map.pressures, pressure_map.maps, strict=True)
    return [(load, seal.mean(one)) for load, one in each if isinstance(one, PressureField)]


def _field_warnings(scene: Scene, tiles: SealTiles, pressure_map: AnyMap) -> Iterator[str]:
    """Warn of pressure fields whose mean is far from the loads."""
    loads = scene.steps.pressures[scene.steps.pressures > 0]
    for load, mean in _field_means(scene, tiles, pressure_map):
        text = f"has the mean {to_text(mean, 'Pa', 3)} over the seal"
        if load is not None and abs(mean - load) > _OFF_LOAD * load:
            yield f"the field of pressure at {to_text(load, 'Pa', 3)} {text}: it is scaled to the load"
        far = loads.size and not loads.min() / _FAR_LOAD < mean < loads.max() * _FAR_LOAD
        if load is None and far:
            yield f"the field of pressure {text}, far from all loads: is its unit right?"


def describe_map(scene: Scene, tiles: SealTiles, pressure_map: AnyMap) -> str:
    """Describe a pressure map as a text: its range over the seal, and the mean of a field; "" if it is uniform."""
    if is_uniform(pressure_map):
        return ""
    fractions = pressure_fractions(scene, tiles, pressure_map)
    text = f"{fractions.min():.3g} to {fractions.max():.3g} of the nominal pressure over the seal"
    means = [to_text(mean, "Pa", 3) for _, mean in _field_means(scene, tiles, pressure_map)]
    return text + (
        f"; mean of the field {' and '.join(means)}, scaled to every load" if means else ""
    )


@dataclass(frozen=True, eq=False)
class TileFluid:
    """Pressures of the fluid at which the permeabilities of cells are needed.

    Parameters
    ----------
    pressures : of the fluid, Pa.
    piecewise : see `flow.PermeabilityTable`.
    relief : by how much the fluid reduces the contact pressure of a cell, at each of the pressures or one for all, Pa.
    """

    pressures: tuple[float, ...]
    piecewise: bool = False
    relief: Array = field(default_factory=partial(np.zeros, 1))

    @classmethod
    def of(cls, scene: Scene) -> TileFluid:
        """Choose the pressures for a scene: those of the flow law, and several where the fluid presses the bodies
        apart.
        """
        drop, fluid = scene.flow.drop, scene.acting_fluid
        pressures, piecewise = tuple(drop.pressures), False
        if fluid is None:
            return cls(pressures)
        if fluid.inlet != fluid.outlet and not drop.law.depends_on_pressure:
            # ln k is nearly straight in the cube root of the pressure that the fluid leaves to the cells
            lowest = min((p for p in scene.steps.pressures if p > 0), default=0.0)
            full = max(lowest, fluid.inlet, fluid.outlet)
            first, last = (float(np.cbrt(full - p)) for p in (fluid.outlet, fluid.inlet))
            between = full - np.linspace(first, last, FLUID_PRESSURES)[1:-1] ** 3
            pressures, piecewise = (fluid.outlet, *between.tolist(), fluid.inlet), True
        relief = fluid.relief(pressures if len(pressures) > 1 else [fluid.mean])
        return cls(pressures, piecewise, relief)

    def effective(self, paths: Array) -> Array:
        """Return the pressures [Pa] that the fluid leaves to the contact along paths (steps, paths).

        Returns an array (steps, fluid pressures × paths).
        """
        left = np.maximum(paths[None] - self.relief[:, None, None], 0.0)
        return np.concatenate(list(left), axis=1)

    def own(self, k: Array) -> Array:
        """Select from permeabilities at all reliefs those at the relief of each fluid pressure.

        Without slip, one permeability serves all fluid pressures.

        k : array (pressures, axis, steps, reliefs × paths, cells), m³.

        Returns an array (pressures, axis, steps, paths, cells) [m³].
        """
        if self.relief.size == 1:
            return k
        split = k.reshape(*k.shape[:3], self.relief.size, -1, k.shape[-1])
        own = range(self.relief.size)
        return np.array([split[n if len(k) > 1 else 0, :, :, n] for n in own])
