"""Pressures of the windows of a seal under a map of the nominal pressure, and the paths that windows share."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from ..base.arrays import Array, Indices
from ..base.errors import InputError
from ..base.quantities import to_text
from ..library.library import local_peaks
from ..loads import LoadProgramme
from ..seal.laid_windows import SealWindows
from ..seal.layouts import Layout
from ..seal.pressure_map import AnyMap, MapsAtLoads, PressedSeal, PressureField, is_uniform
from .scene import Scene
from .seat_rows import SeatMap, SeatRows

#: Most paths of pressure for which every library window has its own curve, under one map and under several at different
#: loads; more are rounded, see `distinct_paths`.
MOST_PATHS, MOST_OF_SEVERAL = 512, 4096
#: Ratio of neighbouring peaks that library windows follow, and most of them. Measured with 24 windows under a wave of
#: ±40 %: leakage on unloading is within 2 % of that with peaks 1.02 apart on a self-affine face, 5 % on a turned one.
#: Peaks of the standard ladder, 1.6 to 3.5 apart, missed it by factors of 0.6 to 1.8. Under a global contact, with 36
#: windows of 24 pixels that nearly close: medians within 0.5 % and 2 %, with the standard ladder 7 % and 16 %; peaks
#: 1.3 apart and at most 10 of them miss them by 3 % and 5 %.
PEAK_RATIO, MOST_PEAKS = 1.15, 16
#: Difference of the mean of a field from the load at which it holds from which on a warning says so.
_OFF_LOAD = 0.1
#: How many times above the highest or below the lowest load the mean of a field is warned of.
_FAR_LOAD = 10.0


def seal_for_maps(layout: Layout, seal_windows: SealWindows) -> PressedSeal:
    """The seal in the coordinates of maps."""
    return PressedSeal(layout.frame(seal_windows.seal.size), seal_windows.outlines)


def pressure_fractions(
    scene: Scene, seal_windows: SealWindows, pressure_map: AnyMap | SeatMap | SeatRows, axis: int
) -> Array:
    """Pressure of the windows along an axis in fractions of the nominal one (steps, windows).

    Raises InputError: the map does not cover the seal.
    """
    count = int(np.prod(seal_windows.draws[axis]))
    if is_uniform(pressure_map):
        return np.broadcast_to(1.0, (len(scene.steps), count))
    points = seal_windows.places(axis).reshape(count, 2)
    if isinstance(pressure_map, SeatRows):
        frame = scene.layout.frame(seal_windows.seal.size)
        assert frame.ends is not None
        extent = pressure_map.breadth / seal_windows.draws[0][0]
        return pressure_map.fractions(np.abs(frame.across(points) - frame.ends[0]), extent, scene.steps.pressures)
    assert not isinstance(pressure_map, SeatMap)  # its rows are solved before
    return seal_for_maps(scene.layout, seal_windows).fractions(pressure_map, points, scene.steps.pressures)


def distinct_paths(fractions: Array) -> tuple[Array, Indices]:
    """Distinct paths (steps, paths) of fractions (steps, n), and the number of the path of each (n,).

    If there are more than `MOST_PATHS`, or `MOST_OF_SEVERAL`, fractions are rounded in their cube root, in which ln k
    is nearly straight, to steps of 1/512 of the largest or larger ones; the mean of those that share a path stays.
    Measured under two maps with 512 paths: leakage within 3e-4.
    """
    changes = [True, *(not np.array_equal(one, other) for one, other in pairwise(fractions))]
    rows = fractions[changes]
    paths, number = _distinct(rows, rows)
    levels, most = float(MOST_PATHS), MOST_PATHS if len(rows) == 1 else MOST_OF_SEVERAL
    while paths.shape[1] > most:
        paths, number = _distinct(np.rint(np.cbrt(rows / rows.max()) * (levels - 1)), rows)
        levels *= 0.8
    return paths[np.cumsum(changes) - 1], number


def most_paths(pressure_map: AnyMap | SeatMap) -> int:
    """Most paths of the windows of a seal under a map."""
    if is_uniform(pressure_map):
        return 1
    return MOST_OF_SEVERAL if isinstance(pressure_map, MapsAtLoads | SeatMap) else MOST_PATHS


def library_peaks(pressures: list[Array], steps: LoadProgramme) -> tuple[float, ...]:
    """Pressures from which library windows are unloaded, so that those of paths (steps, paths) are among them or near.

    They are those of the paths' own peaks, the highest and the lowest among them, at least `PEAK_RATIO` apart, or more
    where they would be too many; in four digits, so that a kept library does not hold them twice but for rounding.
    """
    own = [(paths, local_peaks(paths, steps)) for paths in pressures]
    found = np.unique(np.concatenate([peak[(paths > 0) & (paths < peak)] for paths, peak in own]))
    values = np.unique([float(f"{peak:.4g}") for peak in found.tolist()])[::-1]
    ratio = PEAK_RATIO
    while True:
        chosen: list[float] = []
        for peak in values.tolist():
            gap = 1.02 if peak == values[-1] else ratio
            if not chosen or peak * gap <= chosen[-1]:
                chosen.append(peak)
        if len(chosen) <= MOST_PEAKS:
            return tuple(chosen[::-1])
        ratio *= 1.1


def _distinct(keys: Array, fractions: Array) -> tuple[Array, Indices]:
    """Groups of equal columns of keys, and the mean fraction in each."""
    _, first, number = np.unique(keys, axis=1, return_index=True, return_inverse=True)
    number = number.reshape(-1)
    if keys is fractions:
        return fractions[:, first], number
    members = np.bincount(number)
    return np.array([np.bincount(number, row) / members for row in fractions]), number


def check_map(scene: Scene, seal_windows: SealWindows, pressure_map: AnyMap | SeatMap) -> tuple[str, ...]:
    """Warnings on a map before a run.

    Raises InputError: it does not cover the seal, or a window has more than the faces can carry.
    """
    if isinstance(pressure_map, SeatMap) or is_uniform(pressure_map):
        return ()
    nominal = scene.steps.pressures
    pressures = [nominal[:, None] * pressure_fractions(scene, seal_windows, pressure_map, axis) for axis in (0, 1)]
    for pressure in pressures:
        if pressure.size and pressure.max() >= scene.law.capacity:
            step = int(pressure.max(axis=1).argmax())
            given = f"{to_text(float(pressure.max()), 'Pa')} in a window at {scene.steps[step].name}"
            raise InputError("map", given, f"pressures below the hardness, {to_text(scene.law.capacity, 'Pa')}")
    return (*_pressure_warnings(scene, pressures[0][nominal > 0]), *_field_warnings(scene, seal_windows, pressure_map))


def _pressure_warnings(scene: Scene, pressure: Array) -> Iterator[str]:
    """Warnings of the pressures of the windows at the loaded steps (steps, windows)."""
    if not pressure.size:
        return
    if free := float((pressure <= 0).mean(axis=1).max()):
        yield (
            f"the map is 0 over {free:.0%} of the seal: windows just touch there, and a gap that a flange opens is not "
            "in the leakage"
        )
    least, fluid = float(pressure[pressure > 0].min()), scene.acting_fluid
    if fluid is not None and fluid.parts(least):
        yield (
            f"the fluid carries all of the {to_text(least, 'Pa', 3)} where the map presses least: windows just touch "
            "there, and a gap that the fluid opens is not in the leakage"
        )


def _field_warnings(scene: Scene, seal_windows: SealWindows, pressure_map: AnyMap) -> tuple[str, ...]:
    """Fields whose mean is far from the loads."""
    seal = seal_for_maps(scene.layout, seal_windows)
    warnings: list[str] = []
    if isinstance(pressure_map, PressureField):
        mean, loads = seal.mean(pressure_map), scene.steps.pressures[scene.steps.pressures > 0]
        if loads.size and not loads.min() / _FAR_LOAD < mean < loads.max() * _FAR_LOAD:
            found = to_text(mean, "Pa", 3)
            warnings.append(
                f"the field of pressure has the mean {found} over the seal, far from all loads: is its unit right?"
            )
    elif isinstance(pressure_map, MapsAtLoads):
        for load, one in zip(pressure_map.pressures, pressure_map.maps, strict=True):
            if isinstance(one, PressureField) and abs((mean := seal.mean(one)) - load) > _OFF_LOAD * load:
                found, at = to_text(mean, "Pa", 3), to_text(load, "Pa", 3)
                warnings.append(
                    f"the field of pressure at {at} has the mean {found} over the seal: it is scaled to the load"
                )
    return tuple(warnings)


def describe_map(scene: Scene, seal_windows: SealWindows, pressure_map: AnyMap | SeatMap) -> str:
    """The map as a text: its range in fractions of the nominal pressure, and the mean of a field; "" if uniform."""
    if isinstance(pressure_map, SeatMap):
        return "that of the rows of the seat in plane strain, the measured face being its layer"
    if is_uniform(pressure_map):
        return ""
    fractions = pressure_fractions(scene, seal_windows, pressure_map, 0)
    text = f"{fractions.min():.3g} to {fractions.max():.3g} of the nominal pressure over the seal"
    seal = seal_for_maps(scene.layout, seal_windows)
    maps = pressure_map.maps if isinstance(pressure_map, MapsAtLoads) else (pressure_map,)
    means = [to_text(seal.mean(one), "Pa", 3) for one in maps if isinstance(one, PressureField)]
    return text + (f"; mean of the field {' and '.join(means)}, scaled to every load" if means else "")
