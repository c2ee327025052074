"""From a case to the input of the studies: its face, the windows of it, the seals that are drawn, the scene."""

from collections.abc import Iterator
from dataclasses import replace

from ..base import InputError, to_text
from ..budget import FormTolerance
from ..case.case import Case
from ..case.case_tables import StochasticTable
from ..case.faults import MAP_TABLES, SCENE_TABLES, SEAL_TABLES, with_tables
from ..case.values import unusual
from ..seal.laid_windows import SealWindows
from ..studies import Sampling, Scene, check_sampling, chosen_contact, chosen_flow, chosen_sampler, lay_out_windows
from ..studies.costs import choose_method
from ..studies.scene import gas_warnings, scene_warnings
from ..studies.seat_rows import ROWS, SeatMap, check_map, most_paths
from ..topography import MOST_POINTS, Conditioning, SpikeEffect, Topography, resolving_shape
from ..topography.seat import LEAST_DEPTH, FlatSeat
from ..windows import Partition
from .face import conditioned_face, groove_question, wound_layout
from .prepared import Pair, Prepared, check_memory_of_draws, refused_if_too_large, without_short_waves

#: Fraction of the rms slope from which on a case is warned that the low-pass removes it: by itself, and where the
#: grid of a measured face is limited for its cost. Measured: with 49 % of it gone a turned face leaks 10 to 700 times
#: less.
_LOST_SLOPE, _LOST_TO_COST = 0.1, 0.02
#: Fraction of the rms slope from which on a case is warned that it is of noise.
_NOISE_SLOPE = 0.25


def prepare(case: Case) -> Prepared:
    """Make or read the faces, condition their sum, divide it into windows, and lay out the seals that are drawn.

    Raises InputError: a face that cannot be read or used, or windows or seals that do not suit it.
    """
    with refused_if_too_large(), with_tables(SCENE_TABLES):
        face = conditioned_face(case)
        surface, conditioning, cells = face.surface, face.conditioning, face.cells
        sampling, seals = _seals(case, surface, conditioning, cells)
        surface, seat = _with_seat(case, surface)
        scene = _scene(case, surface, sampling, seals)
        doubts: tuple[str, ...] = ()
        if sampling is not None:
            sampling, doubts = _under_map(case, scene, sampling, seals)
        method, choice = _method(case, scene, cells)
        contact, flow = _contact_and_flow(case, scene, method)
        methods = frozenset({method, *case.compare})
        if methods & {"deterministic", "two-scale"}:
            with with_tables(SEAL_TABLES):
                scene.check_spiral(flow if "two-scale" in methods else "resolved", cells or (2, 1))
        if sampling is not None:
            sampling = replace(sampling, sampler=chosen_sampler(sampling, scene, contact))
        form = None  # of a flat seat
        if case.seat.kind != "flat":
            form = FormTolerance(case.seat.seat(case.folder), case.seat.tolerance, not case.seat_is_broader)
        spikes = SpikeEffect(conditioning.spikes_along_lay, conditioning.spikes_extreme).doubts(conditioning.spikes)
        prepared = Prepared(
            scene=scene,
            cells=cells,
            sampling=sampling,
            conditioning=conditioning,
            overlap=face.overlap,
            continuation=face.continuation,
            methods=methods,
            choice=choice,
            contact=contact,
            flow=flow,
            seat=seat,
            form=form,
            warnings=(
                *plausibility_warnings(case, scene, conditioning),
                *groove_question(case, scene),
                *spikes,
                *doubts,
            ),
        )
        if case.surface.filter_sensitivity:
            without_short_waves(prepared)  # refuses a face too small for it
        return prepared


def _with_seat(case: Case, surface: Topography) -> tuple[Topography, str]:
    """The face with the form of its seat, and what that is as a text, "" where it is flat.

    Raises InputError: a form that is too steep, or narrower than the face.
    """
    seat = case.seat.seat(case.folder)
    if isinstance(seat, FlatSeat):
        return surface, ""
    if case.seat_is_broader:
        return surface, str(seat)
    try:
        formed = seat.on(surface)
    except InputError as error:
        raise (error if error.what == "seat" else error.inside("seat")) from None
    if not seat.matters(surface):
        return surface, f"{seat}: its depth is below {LEAST_DEPTH:.1%} of the rms height, and is left out"
    return formed, str(seat)


def _seals(
    case: Case, surface: Topography, conditioning: Conditioning, cells: Pair | None
) -> tuple[Sampling | None, tuple[SealWindows, ...]]:
    """How seals are drawn from the windows of a face, and their windows for each length; None and none without."""
    if cells is None:
        return None, ()
    partition = Partition(surface.shape, surface.spacing, cells)
    window, least = partition.window_size, 2 * conditioning.shortest_wavelength
    if min(window) < least * (1 - 1e-9):
        given = f"windows of {' × '.join(to_text(w, 'm', 3) for w in window)}"
        raise InputError("cells", given, f"windows of at least two shortest waves, {to_text(least, 'm', 3)}")
    if case.stochastic is None or "stochastic" not in case.methods:
        return None, ()
    sampling = _sampling(case, case.stochastic, window[1], surface.size[1])
    with with_tables(SEAL_TABLES):
        check_sampling(sampling)
        return sampling, lay_out_windows(wound_layout(case), partition, sampling)


def _sampling(case: Case, table: StochasticTable, window_length: float, face_length: float) -> Sampling:
    """The sampling of a table, for windows of such a length [m]; a strip is as long as the face unless given."""
    if table.lengths and min(table.lengths) < window_length * (1 - 1e-9):
        cell, given = to_text(window_length, "m", 3), to_text(min(table.lengths), "m", 3)
        raise InputError("stochastic.length", given, f"at least one cell, {cell}")
    return Sampling(
        length=table.lengths[0] if table.lengths else face_length if case.layout.has_length else None,
        other_lengths=table.lengths[1:],
        breadth=table.breadth,
        realisations=table.realisations,
        resampled=case.output.budget or table.width is not None or case.accuracy is not None,
        library_cells=table.library_cells,
        seed=case.seed,
        sampler=table.sampler,
        pressure=table.pressure,
        library=None if table.library is None else case.folder / table.library,
        width=table.width,
        bounds=table.bounds,
    )


def _scene(case: Case, surface: Topography, sampling: Sampling | None, seals: tuple[SealWindows, ...]) -> Scene:
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
        **_pressures(case, _seal_size(surface, sampling, seals), seals=len(seals)),
        boundary=case.contact.boundary,
        rtol=case.contact.rtol,
        fluid_pressure=case.contact.fluid_pressure,
        nominal=case.load.nominal,
        layout=wound_layout(case),
        solver=case.flow.solver,
        discretisation=case.flow.discretisation,
    )


def _seal_size(surface: Topography, sampling: Sampling | None, seals: tuple[SealWindows, ...]) -> tuple[float, float]:
    """Breadth and length of the seal that loads act on [m]: as given, not in whole windows."""
    if sampling is None:
        return surface.size
    if sampling.length is None:
        breadth, length = seals[0].seal.size
        return breadth, length
    return surface.size[0] if sampling.breadth is None else sampling.breadth, sampling.length


def _pressures(case: Case, seal: tuple[float, float], *, seals: int) -> dict[str, tuple[float, ...]]:
    """Nominal pressures of the cycle on a seal of such a breadth and length [m], one of several or none that are drawn.

    Raises InputError: a force without one length of the seal, or more pressure than the faces can carry.
    """
    known = case.stochastic is not None and (case.stochastic.lengths or not case.layout.has_length)
    if case.load.unit == "N" and not (seals == 1 and known):
        given = f"forces on a seal of {'several lengths' if seals > 1 else 'no length'}"
        raise InputError("load.loading", given, "pressures, forces per length, or one length in [stochastic]")
    area = seal[0] * seal[1] / case.seat.seat(case.folder).load_factor
    found = case.load.pressures(area, seal[1])
    highest = max((*found["loading"], *found["unload_from"]))
    if highest >= case.law.capacity:
        load = to_text(case.load.highest, case.load.unit)
        given = f"{load} on {1e6 * area:.4g} mm², {to_text(highest, 'Pa')}"
        raise InputError("load", given, f"pressures below the hardness, {to_text(case.law.capacity, 'Pa')}")
    return found


def _under_map(
    case: Case, scene: Scene, sampling: Sampling, seals: tuple[SealWindows, ...]
) -> tuple[Sampling, tuple[str, ...]]:
    """The sampling with the map of the pressure over the seal, and what is not plausible in it."""
    breadth, length = _seal_size(scene.surface, sampling, seals)
    with with_tables(MAP_TABLES):
        seat = SeatMap(case.seat.seat(case.folder)) if case.seat_is_broader else None
        if seat is not None:
            seat.seat.rows_below(ROWS, breadth / ROWS)  # refuses a form that is too steep
        made = seat or case.load.pressure_map(case.folder, breadth * length, length)
        sampling = replace(sampling, pressure_map=made)
        check_sampling(sampling)
    paths = most_paths(sampling.pressure_map)
    for laid in seals:
        across = " by ".join(to_text(side, "m", 3) for side in laid.seal.size)
        shape = "" if case.layout.has_length else f"a seal {across}"
        check_memory_of_draws(
            len(scene.steps), laid.draws[0], sampling.realisations, sampling.library_cells, paths, shape
        )
    with with_tables(MAP_TABLES):
        return sampling, (*seals[0].warnings, *check_map(scene, seals[0], sampling.pressure_map))


def _method(case: Case, scene: Scene, cells: Pair | None) -> tuple[str, str]:
    """The method of the case, of "auto" the one that it is, and why."""
    if case.method != "auto":
        return case.method, ""
    assert cells is not None
    method, reason = choose_method(len(scene.steps), scene.surface.shape, cells, _cheaper_flow(scene))
    return method, f"{method}: {reason}"


def _contact_and_flow(case: Case, scene: Scene, method: str) -> tuple[str, str]:
    """How contact and flow of windows are solved, as the case says or as suits the face."""
    contact, flow = (None, None) if case.cells is None else (case.cells.contact, case.cells.flow)
    if flow is None and case.method == "auto" and method == "two-scale":
        flow = _cheaper_flow(scene)
    contact = chosen_contact(contact, scene.contact_shape)
    if contact == "windows" and case.methods != {"deterministic"}:
        scene.check_one_place("cells.contact", contact, "whole")
        _ = scene.uniform_law
    if case.stochastic is not None and case.stochastic.pressure == "global":
        scene.check_one_place("stochastic.pressure", "global", "place")
    if case.stochastic is not None and case.stochastic.pressure != "place":
        _ = scene.uniform_law
    return contact, chosen_flow(flow, scene.surface.shape, scene.discretisation, scene.flow.spiral)


def _cheaper_flow(scene: Scene) -> str:
    """Flow of two scales where the deterministic solution is not affordable: resolved flow is not either."""
    return "elements" if scene.discretisation == "edge" and scene.flow.spiral is None else "links"


def plausibility_warnings(case: Case, scene: Scene, surface: Conditioning) -> tuple[str, ...]:
    """One sentence for each thing in a case and its scene that is not plausible, but may be meant."""
    tested: tuple[str, ...] = ()
    if (test := case.output.test_fluid) is not None:
        tested = tuple(gas_warnings("output.test_fluid", test.fluid, test.inlet_pressure, test.outlet_pressure))
    return (
        *unusual(case),
        *case.fluid_warnings,
        *case.solid_warnings,
        *scene_warnings(scene),
        *tested,
        *_odd_filter(case, scene, surface),
    )


def _odd_filter(case: Case, scene: Scene, surface: Conditioning) -> Iterator[str]:
    """Warn where the low-pass removes much of the measured slope, and say what keeps it."""
    if case.surface.continue_spectrum is not None:
        return
    measured, kept = (to_text(wave, "m", 3) for wave in (surface.shortest_measured, surface.shortest_wavelength))
    asked = case.surface.shortest_wave is not None or case.surface.points is not None
    points = resolving_shape(scene.surface.size, surface.shortest_measured)
    limited = not asked and surface.shape != surface.shape_before and points[0] * points[1] > MOST_POINTS
    if surface.lost_slope > (_LOST_TO_COST if limited else _LOST_SLOPE):
        remedy = f"set surface.points = {list(points)}"
        if case.surface.shortest_wave is not None:
            keys = "surface.shortest_wave" + (" and surface.points" if case.surface.points is not None else "")
            remedy = f"leave out {keys}"
        elif limited:
            most = " × ".join(map(str, surface.shape))
            remedy += f' (unasked no more than {most} are taken), with method = "two-scale" if that takes too long'
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
