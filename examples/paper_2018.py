"""The method of the paper
=======================

This script computes the leakage of a seal by the method of Pérez-Ràfols, Larsson, van Riet and Almqvist (2018). In the
paper, the permeabilities of a random seal are chosen at random at the highest load. For the other loads, they are
extrapolated step by step with randomly chosen derivatives with respect to the pressure. The script compares this
leakage with the leakage of the surface at full resolution, and with the leakage of stochastic seals computed by
femseal.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

import femseal as fs
from femseal.flow import Stencil, solve_flow

#: Numbers of cells along x1 and x2 in the method of the paper, and in the stochastic seals of femseal.
CELLS, OWN_CELLS = (8, 8), (2, 2)
#: Number of windows in a group of similar windows. At the highest load, windows with similar pressures form a group; at
#: all other loads, windows with similar permeabilities do.
ALIKE_IN_PRESSURE, ALIKE_IN_PERMEABILITY = 16, 5


def strip(points: int = 256, seed: int = 2) -> fs.Scene:
    """Return the input of the studies: a self-affine surface with one point per µm, loaded to 1 GPa and unloaded."""
    steel = fs.Solid(young=210e9, poisson=0.3, yield_stress=1.2e9)
    size = (points * 1e-6, points * 1e-6)
    return fs.Scene(
        fs.self_affine((points, points), size, hurst=0.8, rms_slope=0.2, roll_off=1e-4, rng=seed),
        fs.contact_modulus(steel, steel),
        steel.hardness,
        fs.Liquid(viscosity=1e-3),
        inlet_pressure=10e6,
        outlet_pressure=0.0,
        loading=(50e6, 200e6, 500e6, 1000e6),
        unload_from=(1000e6,),
        unloading=(500e6, 50e6),
        fluid_pressure="ignored",
    )


def cut(field: np.ndarray, cells: tuple[int, int], axis: int) -> np.ndarray:
    """Cut a field into windows around the links along an axis; the result has the shape (row, column, n1, n2)."""
    (rows, columns), (n1, n2) = cells, np.array(field.shape) // cells
    if axis == 1:  # half a cell from the windows of the links along x1, which are the cells
        field = np.roll(field, (-(n1 // 2), -(n2 // 2)), axis=(0, 1))
    return field.reshape(rows, n1, columns, n2).swapaxes(1, 2)[: rows - axis]


def global_contact(scene: fs.Scene, cells: tuple[int, int]) -> list[tuple]:
    """Solve the contact of the filtered surface, without waves shorter than half a cell.

    Returns
    -------
    list of (contact state on the coarse grid, gap (n1, n2) on the fine grid)
        The gap contains all waves of the surface. It is negative where short-wave asperities overlap.
    """
    face = scene.surface
    smooth = face.low_pass(face.size[0] / cells[0] / 2)
    coarse = smooth.resample((face.shape[0] // 2, face.shape[1] // 2))
    body = fs.HalfSpace(coarse.shape, coarse.spacing, scene.modulus, scene.boundary)
    load = {"loading": scene.loading, "unload_from": scene.unload_from}
    load |= {"unloading": scene.unloading, "hardness": scene.hardness}
    periodic = tuple(kind == "periodic" for kind in scene.boundary)
    states = []
    for state in fs.load_cycle(coarse.gap(), body, **load):
        opposite = state.contact.raw_gap + coarse.heights
        opposite = fs.Topography(opposite, coarse.spacing, periodic).resample(face.shape).heights
        states.append((state, opposite - face.heights))
    return states


def window_contact(gap0, raw_gap, body, pressure, hardness, deformation):
    """Solve the contact of a window, and return its gap and its plastic deformation [m].

    If the pressure is 0, no contact is solved, and the plastic deformation does not change. The deformation is added to
    the gap of the unfiltered surfaces, which are then moved apart until they do not overlap.
    """
    if pressure == 0:
        apart = raw_gap + deformation
        return apart - min(apart.min(), 0.0), deformation
    law = {"hardness": hardness, "deformation": deformation}
    contact = fs.solve_contact(gap0, body, pressure=min(pressure, hardness), **law)
    return contact.gap, contact.plastic_deformation


def windows_of_links(scene: fs.Scene, axis: int, states: list, cells=CELLS) -> np.ndarray:
    """Solve the contact and the flow of all windows around the links along an axis.

    Returns
    -------
    array (3, step, row, column)
        Pressure [Pa], mean gap of the filtered contact [m] and permeability [m³] of each window.
    """
    gap0 = cut(scene.surface.gap(), cells, axis)
    body = fs.HalfSpace(gap0.shape[2:], scene.surface.spacing, scene.modulus, "mirror")
    left = {None: np.zeros_like(gap0)}  # plastic deformation at the peak before an unloading
    fields = []
    for state, surface_gap in states:
        raw_gap = cut(surface_gap, cells, axis)
        pressure = cut(state.contact.pressure, cells, axis).mean(axis=(2, 3))
        k, deformed = np.empty(pressure.shape), left[state.unloaded_from].copy()
        for w in np.ndindex(pressure.shape):
            gap, deformed[w] = window_contact(
                gap0[w], raw_gap[w], body, pressure[w], scene.hardness, deformed[w]
            )
            k[w] = fs.cell_permeability(gap, scene.surface.spacing, axis=axis).value
        if state.unloaded_from is None:
            left[state.pressure] = deformed
        fields.append((pressure, raw_gap.mean(axis=(2, 3)), k))
    return np.array(fields).swapaxes(0, 1)


def leakage(scene: fs.Scene, k1: np.ndarray, k2: np.ndarray) -> np.ndarray:
    """Compute the leakage [m²/s] of a network at every load step.

    The permeabilities k1 and k2 [m³] of its links along x1 and x2 have the shape (step, row, column).
    """
    length1, length2 = np.divide(scene.surface.size, k1.shape[1:])
    ends = scene.inlet_pressure, scene.outlet_pressure
    drop = float(np.subtract(*map(scene.fluid.potential, ends))) / scene.fluid.reference_density
    rates = []
    for along, across in zip(k1 * length2 / length1, k2 * length1 / length2, strict=True):
        flow = solve_flow(Stencil.network(along, across))
        rates.append(flow.conductance * drop / scene.surface.size[1])
    return np.array(rates)


def alike(rank, first, last, count, rng) -> np.ndarray:
    """Replace each rank by a random rank of the same group.

    The ranks from `first` to `last` − 1 are divided into groups of `count` consecutive ranks.
    """
    rank = np.minimum(rank, last - 1)
    low = first + (rank - first) // count * count
    return rng.integers(low, np.minimum(low + count, last))


def step_down(k, start, end, change, rng) -> np.ndarray:
    """Change the permeability k of each link from one load to the next.

    For each link, a window is chosen at random from the windows whose permeability at the first load (`start`) is
    similar to k. For a closed link, it is one of the closed windows. The change in the permeability of this window,
    from `start` to `end`, is added to k.
    """
    order, closed = np.argsort(start, kind="stable"), np.count_nonzero(start == 0)
    first, last = np.where(k > 0, closed, 0), np.where(k > 0, start.size, closed)
    count = np.where(k > 0, ALIKE_IN_PERMEABILITY, closed)
    chosen = order[alike(np.searchsorted(start[order], k), first, last, count, rng)]
    derivative = np.minimum((end - start)[chosen] / change, 0.0)
    return k + derivative * change


def drawn_links(scene: fs.Scene, windows: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Choose random permeabilities (step, row, column) for the links along one axis of a seal."""
    steps, load = scene.steps, scene.steps.pressures
    pressure, separation, window_k = (field.reshape(len(steps), -1) for field in windows)
    top, links = len(steps.loading) - 1, window_k.shape[1]
    order = np.lexsort((-separation[top], pressure[top]))
    k = np.empty_like(window_k)
    k[top] = window_k[top, order[alike(np.argsort(order), 0, links, ALIKE_IN_PRESSURE, rng)]]
    for branch in (range(top, -1, -1), range(top, len(steps))):
        for s, t in pairwise(branch):
            k[t] = step_down(k[s], window_k[s], window_k[t], load[t] - load[s], rng)
    return k.reshape(windows.shape[1:])


def drawn_seals(scene: fs.Scene) -> np.ndarray:
    """Return the median leakage [m²/s] of stochastic seals that are as large as the surface, computed by femseal."""
    sampling = fs.Sampling(scene.surface.size[1], realisations=16, seed=1)
    return fs.stochastic(scene, OWN_CELLS, sampling).quantile(0.5)


if __name__ == "__main__":
    scene, rng = strip(), np.random.default_rng(1)
    surface_leakage = fs.deterministic(scene).leakage
    states = global_contact(scene, CELLS)
    windows = [windows_of_links(scene, axis, states) for axis in (0, 1)]
    links = leakage(scene, *(permeability for _, _, permeability in windows))
    drawn = [leakage(scene, *(drawn_links(scene, w, rng) for w in windows)) for _ in range(16)]
    low, median, high = np.quantile(drawn, (0.05, 0.5, 0.95), axis=0)
    table = np.array([links, median, low, high, drawn_seals(scene)]) / surface_leakage
    print(f"{'load':31}  surface [mL/(m·s)]  links  random derivatives  stochastic seals")
    for step, whole, ratio in zip(scene.steps, surface_leakage, table.T, strict=True):
        ratios = "{:5.2f}  {:4.2f} ({:.2f} to {:.2f})  {:16.2f}".format(*ratio)
        print(f"{step.name:31}  {1e6 * whole:18.3g}  {ratios}")
