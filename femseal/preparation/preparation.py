"""From a case to the input of the studies, its scene, pieces and drawn seals, and what each study gives and costs.

Sizes of a case are checked against the free memory before anything is made.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from typing import Any

from ..base import Array, InputError, Mapper, to_text
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
from ..face.pieces import FEWEST_POINTS, Cut, usual_pieces
from ..seal.form import SealForm
from ..seal.layouts import AnnularLayout, Layout
from ..seal.tiles import MOST_ROWS, SealTiles
from ..studies import STUDIES, Sampling, Scene, Study, StudyOptions, cut_and_tiles, laid_out
from ..studies.blocks import blocks_of, check_blocks
from ..studies.patch_state import open_leakage_per_permeability
from ..studies.sampling import check_map
from ..studies.seal_contact import form_on_grid
from ..studies.study_registry import Effort, usual_efforts
from ..topography import (
    Conditioning,
    Continuation,
    Overlap,
    Representative,
    Surface,
    representative,
)
from ..topography.seat import Seat
from .face import (
    check_memory,
    conditioned_face,
    filter_doubts,
    form_check_pressures,
    groove_question,
    is_measured,
    with_keys,
    wound_layout,
)


def _keys_of(table: str, names: str) -> dict[str, str]:
    return {name: f"{table}.{name}" for name in names.split()}


#: Arguments of scenes, of seals with their tiles, and of maps of the pressure, by their key in a case.
_SCENE_KEYS = (
    _keys_of("contact", "fluid_pressure")
    | _keys_of("fluid", "inlet_pressure")
    | _keys_of("face", "patches")
)
_SEAL_KEYS = _keys_of("stochastic", "length breadth") | _keys_of(
    "seal", "path unit inlet outlet lay centre inner_radius outer_radius field"
)
_MAP_KEYS = _keys_of("load", "map") | _keys_of(
    "load.map",
    "fractions positions angles path name length_unit pressure_unit points pressure field",
)
#: Memory of the libraries that a run imports [byte].
START_MEMORY = 0.5e9
#: Memory of a tile of a drawn seal, with its element and a row of the solver [byte].
_TILE_BYTES = 4000


def check_memory_of_tiles(layout: Layout, sampling: Sampling, surface: Surface) -> None:
    """Raise InputError if the tiles of a strip or a ring, as large as pieces of a face, do not fit into memory."""
    key, length, breadth = "stochastic.length", sampling.length, sampling.breadth
    if isinstance(layout, AnnularLayout):
        key, length = "seal", layout.circumference
        breadth = layout.outer_radius - layout.inner_radius
    if length is None:
        return
    side1, side2 = Cut.of(surface, usual_pieces(surface)).size
    rows, columns = (breadth or surface.size[0]) / side1, length / side2
    if rows <= MOST_ROWS:  # others are refused when they are laid out
        given, tiles = f"a seal {to_text(length, 'm', 3)} long", rows * columns
        check_memory(key, f"{given}, of {tiles:.3g} tiles", tiles * _TILE_BYTES)


@contextmanager
def refused_if_too_large() -> Iterator[None]:
    """Sizes that no array can have, or numbers that no float can hold, are bad input."""
    try:
        yield
    except (MemoryError, OverflowError, RecursionError) as error:
        expected = f"sizes that fit into memory and numbers of usual size ({str(error) or type(error).__name__})"
        raise InputError("case", "a size or number that is too large", expected) from error


Pair = tuple[int, int]


@dataclass(frozen=True)
class Prepared:
    """Input of the studies, made from a case, and how its surface was made.

    Attributes
    ----------
    scene : surface, loads and fluid.
    cells : number of cells along x1 and x2; None where the surface is not cut.
    sampling : options of the stochastic seals; None without.
    conditioning : how the surface was repaired and filtered.
    overlap : of two measured faces; None of one.
    continuation : of the spectrum of the surface; None without.
    methods : names of the studies to be run.
    seat : the form of the seat as text; "" where it is flat.
    form : the forms of seal and seat with their errors; None of flat ones.
    holds : how many of its longest waves a measured patch has; None of generated surfaces.
    form_pressures : nominal pressures at which the effect of the form of a measured patch is to be solved [Pa]; none
        where the case says what is form.
    flatness : of the seal [m]; None where it is not given.
    warnings : what is not plausible in the case, one sentence each.
    """

    scene: Scene
    cells: Pair | None
    sampling: Sampling | None
    conditioning: Conditioning
    overlap: Overlap | None
    continuation: Continuation | None
    methods: frozenset[str]
    seat: str = ""
    form: FormTolerance | None = None
    holds: Representative | None = None
    form_pressures: tuple[float, ...] = ()
    flatness: float | None = None
    warnings: tuple[str, ...] = ()

    def longer_waves(self, surface: Surface, mapper: Mapper) -> Array | None:
        """Changes of ln(leakage) of drawn seals by waves longer than the patch, see `budget.longer_waves`.

        surface : the face, also on fewer points. None where nothing is to be expected.
        """
        sampling = self.sampling
        if sampling is None or (self.holds is None and self.flatness is None):
            return None
        holds = self.holds or representative(surface)
        scene = replace(self.scene, surface=surface)
        return longer_waves(
            scene,
            sampling.breadth,
            sampling.length,
            holds,
            flatness=self.flatness,
            seed=sampling.seed,
            forms=sampling.form,
            mapper=mapper,
        )

    def estimate(self) -> QuickEstimate | None:
        """Estimate contact and leakage by the spectrum of the surface alone, see `checks.estimate_scene`.

        None where a form, a map of the pressure or a spiral decides. Of a solved study, its result has the estimate.
        """
        if self.sampling is None:
            return estimate_scene(self.scene)
        if not self.sampling.presses_evenly:
            return None
        seal = self.cut_and_tiles[1].seal
        return estimate_scene(self.scene, open_leakage_per_permeability(self.scene, seal))

    def solve_form_effect(self) -> FormEffect | None:
        """Solve contact and flow of a measured patch with and without its form, see `checks.solve_form_effect`.

        None where the case says what is form, and for surfaces that were not measured.
        """
        if not self.form_pressures:
            return None
        scene = self.scene
        return solve_form_effect(
            scene.surface, scene.modulus, scene.law, self.form_pressures, scene.boundary
        )

    @property
    def studies(self) -> list[Study]:
        """The studies to be run, in the order in which they are solved."""
        return [study for study in STUDIES.values() if study.name in self.methods]

    @property
    def solved_studies(self) -> list[Study]:
        """Those of them that are solved: two scales have what the deterministic study has."""
        names = self.methods - ({"deterministic"} if "two-scale" in self.methods else set())
        return [study for study in self.studies if study.name in names]

    @property
    def answer(self) -> Study:
        """The study whose leakage is the answer: the one farthest from the face itself."""
        return self.studies[-1]

    def options(self, study: Study) -> StudyOptions:
        """The options of a study."""
        return StudyOptions(
            self.cells, self.sampling, knows_face=study.name != self.solved_studies[0].name
        )

    def with_realisations(self, count: int) -> Prepared:
        """Return the input with this number of seals, where seals are drawn.

        Two solutions have the same seals, if they draw as many: a number that is left to the scatter of the leakage
        would differ between fluids, faces and laws.
        """
        if self.sampling is None:
            return self
        return replace(self, sampling=replace(self.sampling, realisations=count))

    @property
    def least_points(self) -> Pair:
        """Fewest points of the face along x1 and x2 for pieces of drawn seals."""
        m1, m2 = self.cells if self.cells is not None and "stochastic" in self.methods else (1, 1)
        return FEWEST_POINTS * m1, FEWEST_POINTS * m2

    @property
    def points_divide_by(self) -> Pair:
        """Numbers along x1 and x2 that divide those of the points: of the pieces of blocks."""
        return self.cells if self.cells is not None and "blocks" in self.methods else (1, 1)

    @property
    def cut_and_tiles(self) -> tuple[Cut, SealTiles]:
        """The cut of the face, and the tiles of the drawn seals."""
        assert self.sampling is not None
        return laid_out(self.scene.surface, self.scene.layout, self.cells, self.sampling)

    def replaced(self, **changes: Any) -> Prepared:
        """The input with other attributes."""
        return replace(self, **changes)

    def changed(self, change: ModelChange) -> Prepared:
        """The input with a change of the model."""
        sampling = self.sampling
        if change.forms and sampling is not None:
            sampling = replace(sampling, form=change.forms)
        return replace(self, scene=change.scene, sampling=sampling)

    def solve(self, study: Study, mapper: Mapper) -> Any:
        """Result of a study."""
        options = self.options(study)
        return study.solve(
            self.scene, *(getattr(options, name) for name in study.takes), mapper=mapper
        )

    def cost(self, study: Study, efforts: Sequence[Effort] | None = None) -> tuple[float, float]:
        """Expected time on one core [s] and memory [byte] of a study.

        efforts : of each load step; usual ones unless given.
        """
        known = usual_efforts(len(self.scene.steps)) if efforts is None else efforts
        return study.cost(self.scene, self.options(study), known)

    @property
    def chosen(self) -> dict[str, Any]:
        """What is computed, and how, whether the case says so or leaves it to the program, as plain data."""
        scene = self.scene
        found: dict[str, Any] = {
            "methods": sorted(self.methods),
            "points": list(scene.surface.shape),
            "shortest wave": self.conditioning.shortest_wave,
            **({"seat": self.seat} if self.seat else {}),
            "solver": scene.solver,
        }
        if self.cells is not None:
            found["cells"] = list(self.cells)
        return found

    @property
    def surface_report(self) -> dict[str, Any]:
        """The repair and conditioning of the surface, as plain data."""
        found = asdict(self.conditioning) | (
            {} if self.overlap is None else {"overlap": asdict(self.overlap)}
        )
        if self.continuation is not None:
            found["continuation"] = asdict(self.continuation) | {"text": str(self.continuation)}
        return found


def prepare(case: Case) -> Prepared:
    """Make or read the faces, condition their sum, cut it into pieces, and lay out the seals that are drawn.

    Neither contact nor flow is solved: see `Prepared.solve_form_effect` and `Prepared.estimate` for the checks that
    compute.

    Raises InputError: a face that cannot be read or used, or pieces or seals that do not suit it.
    """
    with refused_if_too_large(), with_keys(_SCENE_KEYS):
        surface, conditioning, overlap, continuation, cells = conditioned_face(case)
        layout = wound_layout(case)
        sampling, size, broader = _seals(case, surface, layout, cells)
        seat = None if case.seat.kind == "flat" else case.seat.make(case.folder)
        factor = 1.0 if seat is None else seat.load_factor
        pressures = _pressures(case, size[0] * size[1] / factor, size[1])
        scene = _scene(case, _with_seat(case, seat, surface, broader), layout, pressures)
        doubts: tuple[str, ...] = ()
        if sampling is not None:
            forms = tuple(one.make(case.folder) for one in case.seal.form or ())
            forms += (seat,) if broader and seat is not None else ()
            sampling, cells, doubts = _under_map(case, scene, sampling, cells, size, forms)
        methods = frozenset(case.methods)
        with with_keys(_SEAL_KEYS):
            if methods & {"deterministic", "two-scale"}:
                scene.check_spiral()
            if "blocks" in methods:
                check_blocks(scene, blocks_of(cells))
        measured = is_measured(case, surface)
        holds = representative(surface) if measured else None
        tested: Iterator[str] = iter(())
        if (test := case.output.test_fluid) is not None:
            ends = test.inlet_pressure, test.outlet_pressure
            tested = gas_warnings("output.test_fluid", test.fluid, *ends)
        return Prepared(
            scene=scene,
            cells=cells,
            sampling=sampling,
            conditioning=conditioning,
            overlap=overlap,
            continuation=continuation,
            methods=methods,
            seat="" if seat is None else str(seat),
            form=_form_tolerance(case, sampling, seat),
            holds=holds,
            form_pressures=form_check_pressures(case, scene) if measured else (),
            flatness=case.seal.flatness,
            warnings=(
                *unusual_values(case),
                *case.named_warnings,
                *conditioning.reading,
                *scene_warnings(scene),
                *tested,
                *filter_doubts(case, surface, conditioning),
                *groove_question(case, surface),
                *conditioning.spike_doubts,
                *(holds.doubts if holds else ()),
                *doubts,
            ),
        )


def _form_tolerance(
    case: Case, sampling: Sampling | None, seat: Seat | None
) -> FormTolerance | None:
    """Errors of the forms of seal and seat; None of flat ones."""
    if sampling is not None and sampling.form:
        tables: list[Any] = [*(case.seal.form or ()), *([] if seat is None else [case.seat])]
        return FormTolerance(sampling.form, tuple(table.tolerance for table in tables))
    return None if seat is None else FormTolerance(seat=seat, tolerance=case.seat.tolerance)


def _seals(
    case: Case, surface: Surface, layout: Layout, cells: Pair | None
) -> tuple[Sampling | None, tuple[float, float], bool]:
    """How seals are drawn, None where none are; breadth and length of the seal that loads act on [m], as given.

    Also whether the seal takes pieces anywhere of the face: of a seat with a form it has the pressures then, where a
    seal in the rows of the face has the form on its heights.
    """
    table = case.stochastic if "stochastic" in case.methods else None
    if table is None:
        return None, surface.size, False
    length = surface.size[1] if table.length is None and layout.has_length else table.length
    sampling = Sampling(length, table.realisations, seed=case.seed, breadth=table.breadth)
    check_memory_of_tiles(layout, sampling, surface)
    if table.realisations is not None:
        needed = 16 * case.load.steps * table.realisations
        check_memory("stochastic.realisations", table.realisations, needed)
    with with_keys(_SEAL_KEYS):
        cut, tiles = laid_out(surface, layout, cells, sampling)
    broader = not tiles.in_place or bool(case.seal.form)
    if length is None:
        return sampling, tiles.size, broader
    if length < (least := cut.size[1]) * (1 - 1e-9):
        expected = f"at least one piece, {to_text(least, 'm', 3)}"
        raise InputError("stochastic.length", to_text(length, "m", 3), expected)
    return sampling, (table.breadth or surface.size[0], length), broader


def _with_seat(case: Case, seat: Seat | None, surface: Surface, broader: bool) -> Surface:
    """The face with the form of its seat.

    broader : the seat has the form beside the face, whose heights stay as they are.

    Raises InputError: a form that is too steep, or narrower than the face; a broader seat with a method of the face.
    """
    if seat is None:
        return surface
    if broader and case.methods != {"stochastic"}:
        given = (
            f"a seal that takes pieces anywhere of the face, with {', '.join(sorted(case.methods))}"
        )
        allowed = "the method stochastic alone, or a seal as broad as the face"
        raise InputError("seat.kind", given, allowed)
    with with_keys({"path": "seat.path"}):
        return surface if broader else seat.on(surface)


def _scene(
    case: Case, surface: Surface, layout: Layout, pressures: dict[str, tuple[float, ...]]
) -> Scene:
    """The face between its solids, under nominal pressures, with its fluid."""
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
    )


def _pressures(case: Case, area: float, length: float) -> dict[str, tuple[float, ...]]:
    """Nominal pressures of the cycle on a seal of an area that carries them [m²] and a length [m].

    Raises InputError: a force without a length of the seal, or more pressure than the faces can carry.
    """
    drawn = case.stochastic if "stochastic" in case.methods else None
    known = drawn is not None and (drawn.length is not None or not case.layout.has_length)
    if case.load.unit == "N" and not known:
        given = "forces on a seal of no length"
        raise InputError(
            "load.loading", given, "pressures, forces per length, or a length in [stochastic]"
        )
    found = case.load.pressures(area, length)
    highest = max((*found["loading"], *found["unload_from"]))
    if highest >= case.law.capacity:
        load = to_text(case.load.highest, case.load.unit)
        given = f"{load} on {1e6 * area:.4g} mm², {to_text(highest, 'Pa')}"
        raise InputError(
            "load", given, f"pressures below the hardness, {to_text(case.law.capacity, 'Pa')}"
        )
    return found


def _under_map(
    case: Case,
    scene: Scene,
    sampling: Sampling,
    cells: Pair | None,
    seal: tuple[float, float],
    forms: tuple[SealForm, ...],
) -> tuple[Sampling, Pair, tuple[str, ...]]:
    """The sampling with the map of the pressure or the form of the seal, the pieces, and what is not plausible."""
    with with_keys(_MAP_KEYS):
        if forms:
            sampling = replace(sampling, form=forms)
        else:
            pressure_map = case.load.pressure_map(case.folder, seal[0] * seal[1], seal[1])
            sampling = replace(sampling, pressure_map=pressure_map)
        cut, tiles = cut_and_tiles(scene, cells, sampling)
        if forms:  # refuses a form that is too steep, or does not cover the seal
            form_on_grid(scene, tiles, forms)
        doubts = *tiles.warnings, *check_map(scene, tiles, sampling.pressure_map)
        return sampling, cut.shape, doubts
