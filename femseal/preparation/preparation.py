"""Prepare the input of the studies from a case: surface, loads, fluid, cells, and the sampling of stochastic seals.

Before large arrays are created, the sizes in the case are compared with the free memory. The preparation does not solve
contact or flow.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from math import lcm
from typing import Any

from ..base import Array, InputError, Mapper, Pair, Shape, to_text
from ..budget import FormTolerance, ModelChange
from ..budget.longer_waves import longer_waves
from ..case.case import Case
from ..case.table_types import unusual_values
from ..checks import (
    FormEffect,
    QuickEstimate,
    estimate_scene,
    gas_warnings,
    scene_warnings,
    solve_form_effect,
)
from ..face.cells import Cut
from ..seal.form import SealForm
from ..seal.layouts import Layout
from ..seal.tiles import SealTiles
from ..studies import (
    Sampling,
    Scene,
    Study,
    StudyCost,
    StudyOptions,
    cut_and_cover,
    cut_and_tiles,
    studies_named,
)
from ..studies.patch_state import open_leakage_per_permeability
from ..studies.sampling import check_map
from ..studies.seal_contact import sample_form
from ..studies.study_list import names_with
from ..topography import (
    Conditioning,
    Continuation,
    Overlap,
    Representative,
    Surface,
    representative,
)
from ..topography.seat import Seat
from .drawing_check import drawing_warnings
from .grooves import groove_warnings, layout_with_grooves
from .keys import MAP_KEYS, SCENE_KEYS, SEAL_KEYS, errors_with_keys
from .measurement import filter_warnings, form_check_pressures, is_measured
from .memory import check_memory, check_memory_of_tiles, refuse_impossible_sizes
from .ring_yield import ring_yield_warnings
from .surface import condition_surface


@dataclass(frozen=True)
class Prepared:
    """Input of the studies that was prepared from a case, with reports on the preparation of the surface.

    Attributes
    ----------
    scene : Scene
        Surface, loads and fluid.
    cells : (int, int) or None
        Numbers of cells along x1 and x2; None if the studies do not need cells.
    sampling : Sampling or None
        Options of the stochastic study; None without a stochastic study.
    conditioning : Conditioning
        Report on the repair and filtering of the surface.
    overlap : Overlap or None
        Overlap of two measured faces; None for a single face.
    continuation : Continuation or None
        Continuation of the spectrum of the surface to shorter wavelengths; None if the spectrum is not continued.
    methods : frozenset of str
        Names of the studies to be run.
    seat : str
        Description of the shape of the seat; "" for a flat seat.
    form : FormTolerance or None
        Form deviations of seal and seat with their tolerances; None if seal and seat are flat.
    longest_waves : Representative or None
        Longest waves of a measured patch, and how many of them fit into the patch; None for a generated surface.
    form_pressures : tuple of float, Pa
        Nominal pressures at which the effect of the form deviation of a measured patch on the leakage is computed;
        empty if the case defines the form.
    flatness : float or None, m
        Flatness of the seal; None if the case does not specify it.
    warnings : tuple of str
        One sentence for each implausible value in the case.
    """

    scene: Scene
    cells: Shape | None
    sampling: Sampling | None
    conditioning: Conditioning
    overlap: Overlap | None
    continuation: Continuation | None
    methods: frozenset[str]
    seat: str = ""
    form: FormTolerance | None = None
    longest_waves: Representative | None = None
    form_pressures: tuple[float, ...] = ()
    flatness: float | None = None
    warnings: tuple[str, ...] = ()

    def longer_waves(self, surface: Surface, mapper: Mapper) -> Array | None:
        """Compute how waves longer than the patch change ln(leakage), see `budget.longer_waves`.

        Returns None if waves longer than the patch are not expected.

        Parameters
        ----------
        surface : Topography or Patches
            Surface of the scene, possibly resampled to a coarser grid.
        mapper : callable
            Function such as the builtin `map`, which computes a stage for many items.
        """
        sampling = self.sampling
        if sampling is None or (self.longest_waves is None and self.flatness is None):
            return None
        return longer_waves(
            replace(self.scene, surface=surface),
            sampling.breadth,
            sampling.length,
            self.longest_waves or representative(surface),
            flatness=self.flatness,
            seed=sampling.seed,
            forms=sampling.form,
            mapper=mapper,
        )

    def estimate(self) -> QuickEstimate | None:
        """Estimate contact and leakage from the spectrum of the surface alone, see `checks.estimate_scene`.

        The quick estimate is not possible if a form deviation, a pressure map or spiral grooves determine the leakage;
        None is returned in these cases. The result of a solved study contains the quick estimate as well.
        """
        if self.sampling is None:
            return estimate_scene(self.scene)
        if not self.sampling.presses_evenly:
            return None
        _, tiles = self.cut_and_tiles
        seal = tiles.seal
        return estimate_scene(self.scene, open_leakage_per_permeability(self.scene, seal))

    def solve_form_effect(self) -> FormEffect | None:
        """Solve contact and flow of a measured patch with and without its form deviation.

        None is returned if the case defines the form, or if the surface was not measured. For the method, see
        `checks.solve_form_effect`.
        """
        if not self.form_pressures:
            return None
        scene = self.scene
        return solve_form_effect(
            scene.surface, scene.modulus, scene.law, self.form_pressures, scene.boundary
        )

    @property
    def studies(self) -> list[Study]:
        """Studies of the run, in the order in which they are solved."""
        return studies_named(self.methods)

    @property
    def solved_studies(self) -> list[Study]:
        """Studies that are solved separately, without those whose result is contained in that of another study."""
        contained = {study.contained for study in self.studies}
        return [study for study in self.studies if study not in contained]

    @property
    def answer(self) -> Study:
        """Study whose leakage is the result of the run, the last study in `studies`.

        If the run includes the stochastic study, the leakage of the whole seal is taken from the stochastic study.
        """
        return self.studies[-1]

    @property
    def only_answer(self) -> Prepared:
        """Copy of the input for the study `answer` alone."""
        return replace(self, methods=frozenset({self.answer.name}))

    def options(self, study: Study) -> StudyOptions:
        """Return the options with which a study is solved in this run."""
        earlier_studies = self.studies[: self.studies.index(study)]
        surface_is_solved = any(
            earlier.solves_whole_surface
            for earlier in earlier_studies
            if earlier in self.solved_studies
        )
        return StudyOptions(self.cells, self.sampling, surface_is_solved)

    def with_realisations(self, count: int) -> Prepared:
        """Return a copy of the input with the given number of realisations of the stochastic study.

        If no number is given, the number of realisations depends on the scatter of the leakage, and therefore on the
        fluid, the surface and the contact law. If a number is given, two runs take the same cells in realisation n, so
        that their leakages can be compared realisation by realisation.
        """
        if self.sampling is None:
            return self
        return replace(self, sampling=replace(self.sampling, realisations=count))

    @property
    def least_points(self) -> Shape:
        """Smallest numbers of points along x1 and x2 that the studies require for their cells."""
        if self.cells is None:
            return 1, 1
        points = [study.least_points(self.cells) for study in self.studies]
        return max(n1 for n1, _ in points), max(n2 for _, n2 in points)

    @property
    def points_divide_by(self) -> Shape:
        """Divisors of the numbers of points along x1 and x2.

        If a study needs cells with equal numbers of points, the divisors are the numbers of cells, otherwise 1.
        """
        if self.cells is None:
            return 1, 1
        divisors = [study.points_divide_by(self.cells) for study in self.studies]
        return lcm(*(d1 for d1, _ in divisors)), lcm(*(d2 for _, d2 in divisors))

    @property
    def cut_and_tiles(self) -> tuple[Cut, SealTiles]:
        """Division of the surface into cells, and tiles of the seal of the stochastic study."""
        assert self.sampling is not None
        return cut_and_cover(self.scene.surface, self.scene.layout, self.cells, self.sampling)

    def replaced(self, **changes: Any) -> Prepared:
        """Return a copy of the input in which the given attributes are replaced."""
        return replace(self, **changes)

    def changed(self, change: ModelChange) -> Prepared:
        """Return a copy of the input in which the scene and the forms are changed, for the error budget."""
        sampling = self.sampling
        if change.forms and sampling is not None:
            sampling = replace(sampling, form=change.forms)
        return replace(self, scene=change.scene, sampling=sampling)

    def solve(self, study: Study, mapper: Mapper) -> Any:
        """Solve a study, and return its result."""
        return study.solve(self.scene, self.options(study), mapper)

    def cost(self, study: Study) -> StudyCost:
        """Return the expected time on one core [s] and the memory [byte] of a study."""
        return study.cost(self.scene, self.options(study))

    @property
    def chosen(self) -> dict[str, Any]:
        """All settings of the run as plain data, including defaults chosen by the program."""
        scene = self.scene
        choices: dict[str, Any] = {
            "methods": sorted(self.methods),
            "points": list(scene.surface.shape),
            "shortest wave": self.conditioning.shortest_wave,
        }
        if self.seat:
            choices["seat"] = self.seat
        choices["solver"] = scene.solver
        if self.cells is not None:
            choices["cells"] = list(self.cells)
        return choices

    @property
    def surface_report(self) -> dict[str, Any]:
        """Report on the repair and conditioning of the surface, as plain data."""
        report = asdict(self.conditioning)
        if self.overlap is not None:
            report["overlap"] = asdict(self.overlap)
        if self.continuation is not None:
            report["continuation"] = asdict(self.continuation) | {"text": str(self.continuation)}
        return report


def prepare(case: Case) -> Prepared:
    """Prepare the input of the studies from a case.

    The function prepares the surface (see `condition_surface`), divides the surface into cells, and determines the size
    of the seal. Contact and flow are not solved by this function; checks that need contact and flow call
    `Prepared.solve_form_effect` and `Prepared.estimate`.

    Raises
    ------
    InputError
        A face cannot be read or used, or the size of the cells or of the seal is not possible with this surface.
    """
    with refuse_impossible_sizes(), errors_with_keys(SCENE_KEYS):
        conditioned = condition_surface(case)
        surface, cells = conditioned.surface, conditioned.cells
        layout = layout_with_grooves(case)
        seal = _lay_out_seal(case, surface, layout, cells)
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
            forms: tuple[SealForm, ...] = tuple(
                table.make(case.folder) for table in case.seal.form or ()
            )
            if seat is not None and seal.form_is_separate:
                forms += (seat,)
            stochastic_input = _add_forms_or_pressure_map(
                case, scene, sampling, cells, seal.size, forms
            )
            sampling, cells = stochastic_input.sampling, stochastic_input.cells
            seal_warnings = stochastic_input.warnings
        with errors_with_keys(SEAL_KEYS):
            for study in case.studies:
                study.check(scene, StudyOptions(cells, sampling))
        surface_is_measured = is_measured(case, surface)
        longest_waves = representative(surface) if surface_is_measured else None
        return Prepared(
            scene=scene,
            cells=cells,
            sampling=sampling,
            conditioning=conditioned.conditioning,
            overlap=conditioned.overlap,
            continuation=conditioned.continuation,
            methods=frozenset(case.methods),
            seat="" if seat is None else str(seat),
            form=_form_tolerance(case, sampling, seat),
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


def _form_tolerance(
    case: Case, sampling: Sampling | None, seat: Seat | None
) -> FormTolerance | None:
    """Collect the form deviations of seal and seat with their tolerances; return None if seal and seat are flat."""
    if sampling is not None and sampling.form:
        # if the seal has a seat, the form of the seat is the last form of the seal
        tolerances = [table.tolerance for table in case.seal.form or ()]
        if seat is not None:
            tolerances.append(case.seat.tolerance)
        return FormTolerance(sampling.form, tuple(tolerances))
    if seat is None:
        return None
    # in this case, the form of the seat was added to the heights of the surface
    return FormTolerance(seat=seat, tolerance=case.seat.tolerance)


@dataclass(frozen=True)
class _Seal:
    """Size of the seal, and whether the shape of the seat is treated as a separate form deviation.

    Attributes
    ----------
    sampling : Sampling or None
        Options of the stochastic study; None without a stochastic study.
    size : (float, float)
        Width and length of the seal [m].
    form_is_separate : bool
        Whether the shape of the seat is treated as a separate form deviation. If True, the seat is a form deviation of
        the whole seal, from which the contact pressure of each tile is computed. If False, the heights of the seat are
        added to the heights of the surface, and the cells of the seal have the same order as on the surface.
    """

    sampling: Sampling | None
    size: Pair
    form_is_separate: bool


def _lay_out_seal(case: Case, surface: Surface, layout: Layout, cells: Shape | None) -> _Seal:
    """Determine the size of the seal, and whether the shape of the seat is treated as a separate form deviation.

    Without a stochastic study, the seal has the size of the surface.
    """
    table = case.stochastic if case.solves_realisations else None
    if table is None:
        return _Seal(sampling=None, size=surface.size, form_is_separate=False)
    length = table.length
    if length is None and layout.has_length:
        length = surface.size[1]
    sampling = Sampling(length, table.realisations, seed=case.seed, breadth=table.breadth)
    check_memory_of_tiles(layout, sampling, surface)
    if table.realisations is not None:
        # two numbers of 8 byte for each realisation and load step
        needed = 16 * case.load.steps * table.realisations
        check_memory("stochastic.realisations", table.realisations, needed)
    with errors_with_keys(SEAL_KEYS):
        cut, tiles = cut_and_cover(surface, layout, cells, sampling)
    form_is_separate = not tiles.in_order or bool(case.seal.form)
    if length is None:  # the shape of the seal determines its size
        return _Seal(sampling, tiles.size, form_is_separate)
    cell_length = cut.size[1]
    if length < cell_length * (1 - 1e-9):
        expected = f"at least the length of a cell, {to_text(cell_length, 'm', 3)}"
        raise InputError("stochastic.length", to_text(length, "m", 3), expected)
    breadth = table.breadth or surface.size[0]
    return _Seal(sampling, (breadth, length), form_is_separate)


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


@dataclass(frozen=True)
class _StochasticInput:
    """Input of the stochastic study, including the form deviations or the pressure map of the seal.

    sampling : options of the stochastic study.
    cells : numbers of cells of the surface along x1 and x2.
    warnings : warnings about the tiles and the pressure map.
    """

    sampling: Sampling
    cells: Shape
    warnings: tuple[str, ...]


def _add_forms_or_pressure_map(
    case: Case,
    scene: Scene,
    sampling: Sampling,
    cells: Shape | None,
    size: Pair,
    forms: tuple[SealForm, ...],
) -> _StochasticInput:
    """Add the form deviations of the seal, or else the pressure map of the case, to the options of the study.

    Raises InputError if a form is too steep, or if the forms or the pressure map do not cover the seal.

    size : width and length of the seal [m].
    """
    with errors_with_keys(MAP_KEYS):
        if forms:
            sampling = replace(sampling, form=forms)
        else:
            breadth, length = size
            pressure_map = case.load.pressure_map(case.folder, breadth * length, length)
            sampling = replace(sampling, pressure_map=pressure_map)
        # the study chooses the numbers of cells if the case does not contain them (`cells` is None)
        cut, tiles = cut_and_tiles(scene, cells, sampling)
        if forms:
            # raises InputError if a form is too steep or does not cover the seal
            sample_form(scene, tiles, forms)
        map_warnings = check_map(scene, tiles, sampling.pressure_map)
        return _StochasticInput(
            sampling=sampling, cells=cut.shape, warnings=(*tiles.warnings, *map_warnings)
        )
