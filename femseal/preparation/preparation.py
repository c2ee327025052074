"""Prepare the input of the studies from a case: surface, loads, fluid, cells, and the sampling of stochastic seals.

Before large arrays are created, the sizes in the case are compared with the free memory. The preparation does not solve
contact or flow.
"""

from __future__ import annotations

from collections.abc import Iterator

from ..base import InputError, to_text
from ..budget.study_input import StudyInput
from ..case.case import Case
from ..case.table_types import unusual_values
from ..checks import (
    gas_warnings,
    scene_warnings,
)
from ..seal.layouts import Layout
from ..studies import (
    Scene,
    StudyOptions,
)
from ..studies.study_list import names_with
from ..topography import (
    Surface,
    representative,
)
from ..topography.seat import Seat
from .drawing_check import drawing_warnings
from .grooves import groove_warnings, layout_with_grooves
from .keys import SCENE_KEYS, SEAL_KEYS, errors_with_keys
from .measurement import filter_warnings, form_check_pressures, is_measured
from .memory import refuse_impossible_sizes
from .ring_yield import ring_yield_warnings
from .seal_input import add_forms_or_pressure_map, form_tolerance, lay_out_seal
from .surface import condition_surface


def prepare(case: Case) -> StudyInput:
    """Prepare the input of the studies from a case.

    The function prepares the surface (see `condition_surface`), divides the surface into cells, and determines the size
    of the seal. Contact and flow are not solved by this function; checks that need contact and flow call
    `StudyInput.solve_form_effect` and `StudyInput.estimate`.

    Raises
    ------
    InputError
        A face cannot be read or used, or the size of the cells or of the seal is not possible with this surface.
    """
    with refuse_impossible_sizes(), errors_with_keys(SCENE_KEYS):
        conditioned = condition_surface(case)
        surface, cells = conditioned.surface, conditioned.cells
        layout = layout_with_grooves(case)
        seal = lay_out_seal(case, surface, layout, cells)
        seat = None if case.seat.kind == "flat" else case.seat.make(case.folder)
        load_factor = 1.0 if seat is None else seat.load_factor
        breadth, length = seal.size
        loaded_area = breadth * length / load_factor
        pressures = _nominal_pressures(case, loaded_area, length)
        surface_on_seat = _add_seat(case, seat, surface, seal.form_is_separate)
        scene = _make_scene(case, surface_on_seat, layout, pressures)
        sampling = seal.sampling
        seal_warnings: tuple[str, ...] = ()
        if sampling is not None:
            separate_seat = seat if seal.form_is_separate else None
            stochastic_input = add_forms_or_pressure_map(
                case, scene, sampling, cells, seal.size, separate_seat
            )
            sampling, cells = stochastic_input.sampling, stochastic_input.cells
            seal_warnings = stochastic_input.warnings
        with errors_with_keys(SEAL_KEYS):
            for study in case.studies:
                study.check(scene, StudyOptions(cells, sampling))
        surface_is_measured = is_measured(case, surface)
        longest_waves = representative(surface) if surface_is_measured else None
        return StudyInput(
            scene=scene,
            cells=cells,
            sampling=sampling,
            conditioning=conditioned.conditioning,
            overlap=conditioned.overlap,
            continuation=conditioned.continuation,
            methods=frozenset(case.methods),
            seat="" if seat is None else str(seat),
            form=form_tolerance(case, sampling, seat),
            longest_waves=longest_waves,
            form_pressures=form_check_pressures(case, scene) if surface_is_measured else (),
            flatness=case.seal.flatness,
            warnings=(
                *unusual_values(case),
                *case.named_warnings,
                *conditioned.conditioning.reading,
                *scene_warnings(scene),
                *ring_yield_warnings(case, max(step.pressure for step in scene.steps)),
                *_test_fluid_warnings(case),
                *filter_warnings(case, surface, conditioned.conditioning),
                *groove_warnings(case, surface),
                *drawing_warnings(case, surface),
                *conditioned.conditioning.spike_warnings,
                *(longest_waves.warnings if longest_waves is not None else ()),
                *seal_warnings,
            ),
        )


def _test_fluid_warnings(case: Case) -> Iterator[str]:
    """Warn if the test fluid is treated as an ideal gas, although it is a real gas at the test pressures."""
    test = case.output.test_fluid
    if test is not None:
        key = "output.test_fluid"
        yield from gas_warnings(key, test.fluid, test.inlet_pressure, test.outlet_pressure)


def _add_seat(case: Case, seat: Seat | None, surface: Surface, form_is_separate: bool) -> Surface:
    """Add the heights of a seat to the heights of the surface, unless the seat is a form deviation of the whole seal.

    Raises
    ------
    InputError
        The shape of the seat is too steep, or the seat is narrower than the surface. The error is also raised if the
        seat is a form deviation of the whole seal, but the run includes studies other than the stochastic study.
    """
    if seat is None:
        return surface
    if form_is_separate and not all(study.has_realisations for study in case.studies):
        methods = ", ".join(sorted(case.methods))
        given = f"a seal that takes cells from anywhere on the surface, with {methods}"
        method = names_with("has_realisations")
        expected = f"the method {method} alone, or a seal that is as wide as the surface"
        raise InputError("seat.kind", given, expected)
    if form_is_separate:
        return surface
    with errors_with_keys({"path": "seat.path"}):
        return seat.add_to(surface)


def _make_scene(
    case: Case, surface: Surface, layout: Layout, pressures: dict[str, tuple[float, ...]]
) -> Scene:
    """Create the scene, which consists of the surface, the solids, the loads and the fluid.

    pressures : nominal pressures of the load cycle [Pa], see `LoadTable.pressures`.
    """
    fluid = case.fluid
    return Scene(
        surface=surface,
        modulus=case.modulus,
        hardness=case.law,
        fluid=fluid.fluid,
        inlet_pressure=fluid.inlet_pressure,
        outlet_pressure=fluid.outlet_pressure,
        surroundings=fluid.ambient_pressure,
        **pressures,
        boundary=case.contact.boundary,
        rtol=case.contact.rtol,
        fluid_pressure=case.contact.fluid_pressure,
        nominal=case.load.nominal,
        layout=layout,
        solver=case.flow.solver,
        body_yield_stress=case.body_yield_stress,
    )


def _nominal_pressures(case: Case, area: float, length: float) -> dict[str, tuple[float, ...]]:
    """Convert the loads of a case to nominal pressures [Pa].

    Parameters
    ----------
    case : Case
        The case.
    area : float
        Area of the seal that carries the loads [m²].
    length : float
        Length of the seal [m].

    Raises
    ------
    InputError
        The loads are forces, but the length of the seal is not known; or a nominal pressure is not below the hardness.
    """
    stochastic = case.stochastic if case.solves_realisations else None
    has_length = stochastic is not None and (
        stochastic.length is not None or not case.layout.has_length
    )
    if case.load.unit == "N" and not has_length:
        expected = "pressures, forces per length, or a length in [stochastic]"
        raise InputError(
            "load.loading", "forces, although the length of the seal is unknown", expected
        )
    pressures = case.load.pressures(area, length)
    highest = max((*pressures["loading"], *pressures["unload_from"]))
    capacity = case.law.capacity
    if highest >= capacity:
        load = to_text(case.load.highest, case.load.unit)
        given = f"{load} on {1e6 * area:.4g} mm², {to_text(highest, 'Pa')}"
        raise InputError("load", given, f"pressures below the hardness, {to_text(capacity, 'Pa')}")
    return pressures
