"""Compute the nominal pressure of the tiles of a seal under a pressure map, and check the map."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np

from ..base import Array, Indices, InputError, to_text
from ..scene import Scene
from ..seal.layouts import Layout
from ..seal.pressure_map import AnyMap, MapsAtLoads, PressedSeal, PressureField, is_uniform
from ..seal.tiles import SealTiles

#: Largest number of pressure paths on which every cell is interpolated: first with a single pressure map, then with
#: several pressure maps for different loads. If there are more paths, similar paths are merged, see `distinct_paths`.
MOST_PATHS, MOST_OF_SEVERAL = 512, 4096
#: A warning is given if the mean of a pressure field differs from the load for which it is valid by this fraction.
_OFF_LOAD = 0.1
#: A warning is given if the mean of a pressure field is above the highest or below the lowest load by this factor.
_FAR_LOAD = 10.0


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
    # number of equidistant values to which the cube roots are rounded
    value_count = float(MOST_PATHS)
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
    if fluid is not None and fluid.carrier == "total":
        carried = max(fluid.mean_if_separated, 0.0)
    warnings = [*_field_warnings(scene, tiles, pressure_map)]
    # fraction of the tiles without contact pressure, at the load step at which it is largest
    without_contact = pressure[nominal > 0] <= carried
    unloaded = float(without_contact.mean(axis=1).max(initial=0.0))
    if unloaded:
        warnings.insert(
            0,
            f"over {unloaded:.0%} of the seal the map presses no more than the fluid carries, "
            f"{to_text(carried, 'Pa', 3)}: tiles just touch there, and the leakage does not include a gap that opens",
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
