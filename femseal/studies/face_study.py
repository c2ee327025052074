"""Solve contact and flow of a whole surface at each load step, on all pixels, and the flow through its cells."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from math import ceil
from typing import Any

import numpy as np

from ..base import Mapper, Shape, Stage
from ..base.shared_arrays import give_back, one_at_a_time, shared_empty
from ..checks import estimate_scene, result_warnings
from ..face.cell_flow import FlowSettings, SolveCounts, drop_fractions
from ..face.cells import CellState
from ..face.cut import Cut
from ..face.flow_concentration import blocks_of_one_wave, participation_number
from ..scene import Scene
from ..topography import Patches
from .cell_states import join_states
from .cost_model import state_memory
from .face_result import FaceResult, FaceState, fields_of_rows
from .patch_leakage import PatchLeakage, permeabilities_of_patches


def deterministic(scene: Scene, *, mapper: Mapper = map) -> FaceResult:
    """Solve contact and flow of the whole surface at full resolution, at every step of the load programme.

    Large fields are stored on disk, so that only one load step at a time must fit into memory, see `shared_empty`.

    Parameters
    ----------
    scene : Scene
        The surface, its load and its fluid.
    mapper : callable
        Function such as the builtin `map`, which computes a stage for many items, possibly in several processes.

    Raises
    ------
    InputError
        The spiral lay is not possible on this surface, see `Scene.check_spiral`.
    NotConverged
        The contact solver failed. If the flow solver fails, the leakage is NaN and the reason is in `failures`.

    Examples
    --------
    >>> import femseal as fs
    >>> face = fs.self_affine((32, 64), (32e-6, 64e-6), hurst=0.8, rms_slope=0.2, roll_off=20e-6, rng=1)
    >>> scene = fs.Scene(face, 115e9, 3e9, fs.Liquid(1e-3), 1e6, 0.0, loading=(5e7, 2e8))
    >>> result = deterministic(scene)
    >>> [f"{leak:.2g} m²/s" for leak in result.leakage]
    ['2.7e-06 m²/s', '1.3e-06 m²/s']
    """
    return _checked(scene, solve_face(scene, mapper))


def _checked(scene: Scene, face: FaceResult) -> FaceResult:
    """Add the quick estimate and the plausibility warnings to a result."""
    estimate = estimate_scene(scene)
    warnings = result_warnings(
        scene,
        face.leakage,
        face.mean_gap,
        estimate,
        plastic_depth=face.plastic_depth,
        edge_distance=np.array([state.edge_distance for state in face.states]),
    )
    return replace(face, warnings=warnings, quick_estimate=estimate)


def solve_face(scene: Scene, mapper: Mapper) -> FaceResult:
    """Solve contact and flow of the whole surface as `deterministic` does, but without plausibility checks."""
    scene.check_spiral()
    surface = scene.surface
    shape = (len(scene.steps), *scene.surface.shape)  # (step, row, column)
    fields = {name: shared_empty(shape, np.float32) for name in ("gap", "pressure", "potential")}
    bytes_of_bits = ceil(surface.heights.size / 8)  # one bit for each pixel
    fields["plastic"] = shared_empty((shape[0], bytes_of_bits), np.uint8)
    fluid_pressure = shared_empty(shape, np.float32)
    states: list[FaceState] = []
    take = partial(FaceState.of, flow=scene.flow)
    memory = state_memory(surface.heights.size)
    solved_states = scene.contact_states(take, memory=memory, mapper=mapper)
    for s, state in enumerate(solved_states):
        for name, values in fields.items():
            values[s] = getattr(state, name)
            give_back(values)
        fluid_pressure[s] = scene.pressure_at(state.potential)
        give_back(fluid_pressure)
        # the stored state refers to the shared arrays, so that the memory of the fields in `state` can be freed
        states.append(replace(state, **{name: values[s] for name, values in fields.items()}))
    for values in (*fields.values(), fluid_pressure):
        values.flags.writeable = False
    patches = None
    if isinstance(surface, Patches):
        solve = partial(permeabilities_of_patches, surface.widths, surface.spacing, scene.flow)
        patch_k = list(mapper(Stage("flow of patches", solve), fields["gap"]))
        patches = PatchLeakage(scene.unit_leakage * np.array(patch_k).T)
    names = (
        "contact_fraction",
        "plastic_fraction",
        "plastic_depth",
        "mean_gap",
        "row_pressure",
        "permeability",
        "carried",
    )
    step_values: dict[str, Any] = {
        name: np.array([getattr(state, name) for state in states]) for name in names
    }
    steps_and_states = zip(scene.steps, states, strict=True)
    return FaceResult(
        steps=scene.steps,
        leakage=scene.unit_leakage * step_values.pop("permeability"),
        carried_pressure=step_values.pop("carried"),
        **fields_of_rows(step_values.pop("row_pressure"), surface.spacing[0]),
        **step_values,
        gap=fields["gap"],
        contact_pressure=fields["pressure"],
        fluid_pressure=fluid_pressure,
        entry_pressure=scene.entry_pressures(one_at_a_time(fields["gap"])),
        patches=patches,
        states=tuple(states),
        residual=max(state.residual for state in states),
        failures=tuple(
            f"{step.name}: {state.flow_failure}"
            for step, state in steps_and_states
            if state.flow_failure
        ),
        face_solve_counts=SolveCounts.total(state.solve_counts for state in states),
    )


def two_scale(scene: Scene, cells: Shape, *, mapper: Mapper = map) -> FaceResult:
    """Solve contact and flow of the whole surface, and compute the permeability of each of its cells.

    Parameters
    ----------
    scene : Scene
        The surface, its load and its fluid.
    cells : (int, int)
        Numbers of cells along x1 and x2.
    mapper : callable
        Function such as the builtin `map`, which computes a stage for many items, possibly in several processes.

    Raises
    ------
    InputError
        The surface cannot be divided into these numbers of cells; or the spiral lay is not possible on this surface,
        see `Scene.check_spiral`.
    NotConverged
        The contact solver failed. If the flow solver fails, the permeability is NaN and the reason is in `failures`.

    Examples
    --------
    >>> import femseal as fs
    >>> face = fs.self_affine((32, 64), (32e-6, 64e-6), hurst=0.8, rms_slope=0.2, roll_off=20e-6, rng=1)
    >>> scene = fs.Scene(face, 115e9, 3e9, fs.Liquid(1e-3), 1e6, 0.0, loading=(5e7, 2e8))
    >>> two_scale(scene, (2, 4)).cells.mean_gap.shape  # (step, row, column)
    (2, 2, 4)
    """
    return _checked(scene, cut_into_cells(scene, Cut.of(scene.surface, cells), mapper))


def cut_into_cells(scene: Scene, cut: Cut, mapper: Mapper) -> FaceResult:
    """Solve a surface and its cells as `two_scale` does, but without plausibility checks."""
    face = solve_face(scene, mapper)
    blocks = blocks_of_one_wave(scene.surface)
    solve = partial(_solve_cells, cut=cut, flow=scene.flow, blocks=blocks)
    cell_states = list(mapper(Stage("cells of the face", solve), face.states))
    cells = join_states(scene, cut, scene.steps, cell_states)
    cells = replace(cells, surface_leakage=face.leakage, patches=face.patches)
    return replace(face, cells=cells, failures=(*face.failures, *cells.failures))


def _solve_cells(state: FaceState, *, cut: Cut, flow: FlowSettings, blocks: Shape) -> CellState:
    """Cut the fields of a contact state into cells, and solve the flow through each cell."""
    gap, potential = state.gap.astype(float), state.potential.astype(float)
    plastic = np.unpackbits(state.plastic, count=gap.size).view(bool).reshape(gap.shape)
    dissipation = potential  # NaN everywhere if the flow failed
    if np.isfinite(potential).any():
        dissipation = drop_fractions(gap, cut.spacing, potential, flow)
    cell_flow = replace(flow, spiral=None)  # spiral grooves belong to the seal, not to its cells
    cells = CellState.of(gap, state.pressure, cut, cell_flow, plastic, dissipation)
    carriers = participation_number(dissipation, blocks)
    return replace(
        cells,
        flow_failure=state.flow_failure,
        carriers=carriers,
        edge_distance=state.edge_distance,
    )
