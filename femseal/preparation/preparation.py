"""From a case to the input of the studies: its face, the pieces of it, the seals that are drawn, the scene."""

from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import Any

from ..base import InputError, to_text
from ..budget import FormTolerance
from ..case.case import Case
from ..case.faults import MAP_TABLES, SCENE_TABLES, SEAL_TABLES, with_tables
from ..case.values import unusual
from ..seal.form import SealForm
from ..seal.layouts import Layout
from ..studies import Sampling, Scene, cut_and_tiles, laid_out
from ..studies.blocks import blocks_of, check_blocks
from ..studies.doubts import gas_warnings, scene_warnings
from ..studies.sampling import check_map
from ..studies.seal_contact import form_on_grid
from ..topography import (
    Conditioning,
    Topography,
    resolving_shape,
    shortest_place,
)
from ..topography.seat import Seat
from .face import conditioned_face, groove_question, measured_patch, wound_layout
from .prepared import Pair, Prepared, check_memory, check_memory_of_tiles, refused_if_too_large

#: Fraction of the rms slope from which on a case is warned that the low-pass removes it. Measured: with 49 % of it gone
#: a turned face leaks 10 to 700 times less.
_LOST_SLOPE = 0.1
#: Fraction of the rms slope from which on a case is warned that it is of noise.
_NOISE_SLOPE = 0.25


def prepare(case: Case) -> Prepared:
    """Make or read the faces, condition their sum, cut it into pieces, and lay out the seals that are drawn.

    Raises InputError: a face that cannot be read or used, or pieces or seals that do not suit it.
    """
    with refused_if_too_large(), with_tables(SCENE_TABLES):
        face = conditioned_face(case)
        surface, conditioning, layout = face.surface, face.conditioning, wound_layout(case)
        _check_pieces(surface, conditioning, cells := face.cells)
        sampling, size, broader = _seals(case, surface, layout, cells)
        seat = None if case.seat.kind == "flat" else case.seat.make(case.folder)
        scene = _scene(case, _with_seat(case, seat, surface, broader), layout, size)
        doubts: tuple[str, ...] = ()
        if sampling is not None:
            forms = tuple(one.make(case.folder) for one in case.seal.form or ())
            forms += (seat,) if broader and seat is not None else ()
            sampling, cells, doubts = _under_map(case, scene, sampling, cells, size, forms)
        methods = frozenset(case.methods)
        with with_tables(SEAL_TABLES):
            if methods & {"deterministic", "two-scale"}:
                scene.check_spiral()
            if "blocks" in methods:
                check_blocks(scene, blocks_of(cells))
        holds, effect = measured_patch(case, surface, scene)
        return Prepared(
            scene=scene,
            cells=cells,
            sampling=sampling,
            conditioning=conditioning,
            overlap=face.overlap,
            continuation=face.continuation,
            methods=methods,
            seat="" if seat is None else str(seat),
            form=_form_tolerance(case, sampling, seat),
            holds=holds,
            form_effect=effect,
            flatness=case.seal.flatness,
            warnings=(
                *plausibility_warnings(case, scene, conditioning),
                *groove_question(case, surface),
                *conditioning.spike_doubts,
                *(holds.doubts if holds else ()),
                *(effect.doubts if effect else ()),
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


def _check_pieces(surface: Topography, conditioning: Conditioning, cells: Pair | None) -> None:
    """Refuse pieces of fewer than two shortest waves a side."""
    least = 2 * conditioning.shortest_wave
    sides = [side / m for side, m in zip(surface.size, cells or (1, 1), strict=True)]
    if cells is not None and min(sides) < least * (1 - 1e-9):
        given = f"pieces of {' × '.join(to_text(side, 'm', 3) for side in sides)}"
        allowed = f"pieces of at least two shortest waves, {to_text(least, 'm', 3)}"
        raise InputError("cells", given, allowed)


def _seals(
    case: Case, surface: Topography, layout: Layout, cells: Pair | None
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
        steps = len(case.load.loading) + len(case.load.peaks) * (1 + len(case.load.unloading))
        check_memory("stochastic.realisations", table.realisations, 16 * steps * table.realisations)
    with with_tables(SEAL_TABLES):
        cut, tiles = laid_out(surface, layout, cells, sampling)
    broader = not tiles.in_place or bool(case.seal.form)
    if length is None:
        return sampling, tiles.size, broader
    if length < (least := cut.size[1]) * (1 - 1e-9):
        expected = f"at least one piece, {to_text(least, 'm', 3)}"
        raise InputError("stochastic.length", to_text(length, "m", 3), expected)
    return sampling, (table.breadth or surface.size[0], length), broader


def _with_seat(case: Case, seat: Seat | None, surface: Topography, broader: bool) -> Topography:
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
    with with_tables({"path": "seat"}):
        return surface if broader else seat.on(surface)


def _scene(case: Case, surface: Topography, layout: Layout, seal: tuple[float, float]) -> Scene:
    """The face between its solids, under its loads, with its fluid."""
    fluid = case.fluid
    return Scene(
        surface=surface,
        modulus=case.modulus,
        hardness=case.law,
        fluid=fluid.fluid,
        inlet_pressure=fluid.inlet_pressure,
        outlet_pressure=fluid.outlet_pressure,
        surroundings=fluid.ambient_pressure,
        **_pressures(case, seal),
        boundary=case.contact.boundary,
        rtol=case.contact.rtol,
        fluid_pressure=case.contact.fluid_pressure,
        nominal=case.load.nominal,
        layout=layout,
        solver=case.flow.solver,
    )


def _pressures(case: Case, seal: tuple[float, float]) -> dict[str, tuple[float, ...]]:
    """Nominal pressures of the cycle on a seal of such a breadth and length [m].

    Raises InputError: a force without a length of the seal, or more pressure than the faces can carry.
    """
    drawn = case.stochastic if "stochastic" in case.methods else None
    known = drawn is not None and (drawn.length is not None or not case.layout.has_length)
    if case.load.unit == "N" and not known:
        given = "forces on a seal of no length"
        raise InputError(
            "load.loading", given, "pressures, forces per length, or a length in [stochastic]"
        )
    area = seal[0] * seal[1] / case.seat.make(case.folder).load_factor
    found = case.load.pressures(area, seal[1])
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
    with with_tables(MAP_TABLES):
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


def plausibility_warnings(case: Case, scene: Scene, surface: Conditioning) -> tuple[str, ...]:
    """One sentence for each thing in a case and its scene that is not plausible, but may be meant."""
    tested: Iterable[str] = ()
    if (test := case.output.test_fluid) is not None:
        ends = test.inlet_pressure, test.outlet_pressure
        tested = gas_warnings("output.test_fluid", test.fluid, *ends)
    return (
        *unusual(case),
        *case.named_warnings,
        *scene_warnings(scene),
        *tested,
        *_odd_filter(case, scene, surface),
    )


def _odd_filter(case: Case, scene: Scene, surface: Conditioning) -> Iterator[str]:
    """Warn where the low-pass removes much of the measured slope, and say what keeps it."""
    if case.surface.continue_spectrum is not None:
        return
    measured, kept = (
        to_text(wave, "m", 3) for wave in (surface.shortest_measured, surface.shortest_wave)
    )
    unseen = surface.shortest_wave == surface.shortest_seen  # as `femseal check` says
    if not unseen and surface.lost_slope > _LOST_SLOPE:
        size = shortest_place(scene.surface).size
        remedy = f"set surface.points = {list(resolving_shape(size, surface.shortest_measured))}"
        if case.surface.shortest_wave is not None:
            also = " and surface.points" if case.surface.points else ""
            remedy = f"leave out surface.shortest_wave{also}"
        yield (
            f"the low-pass at {kept} removes {surface.lost_slope:.0%} of the rms slope of the face, whose waves down "
            f"to {measured} stand above noise: leakage may be off by factors; to keep them {remedy}"
        )
    noise = 1 - surface.rms_slope_measured / surface.rms_slope if surface.rms_slope else 0.0
    if noise > _NOISE_SLOPE:
        yield (
            f"{noise:.0%} of the rms slope is of waves from {kept} to {measured}, which are noise or beyond the "
            f"instrument: surface.shortest_wave = '{measured}' removes them"
        )
