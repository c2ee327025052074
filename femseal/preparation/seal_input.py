"""Determine the size of the seal of a case, and its form deviations or its pressure map."""

from __future__ import annotations

from dataclasses import dataclass, replace

from ..base import InputError, Pair, Shape, to_text
from ..budget import FormTolerance
from ..case.case import Case
from ..seal.form import SealForm
from ..seal.layouts import Layout
from ..studies import Sampling, Scene, cut_and_cover, cut_and_tiles
from ..studies.seal_contact import sample_form
from ..studies.tile_pressure import check_map
from ..topography import Surface
from ..topography.seat import Seat
from .keys import MAP_KEYS, SEAL_KEYS, errors_with_keys
from .memory import check_memory, check_memory_of_tiles


@dataclass(frozen=True)
class SealSize:
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


def lay_out_seal(case: Case, surface: Surface, layout: Layout, cells: Shape | None) -> SealSize:
    """Determine the size of the seal, and whether the shape of the seat is treated as a separate form deviation.

    Without a stochastic study, the seal has the size of the surface.
    """
    table = case.stochastic if case.solves_realisations else None
    if table is None:
        return SealSize(sampling=None, size=surface.size, form_is_separate=False)
    length = table.length
    if length is None and layout.has_length:
        length = surface.size[1]
    sampling = Sampling(length, table.realisations, seed=case.seed, breadth=table.breadth)
    check_memory_of_tiles(layout, sampling, surface)
    if table.realisations is not None:
        # two numbers of 8 bytes for each realisation and load step
        needed = 16 * case.load.steps * table.realisations
        check_memory("stochastic.realisations", table.realisations, needed)
    with errors_with_keys(SEAL_KEYS):
        cut, tiles = cut_and_cover(surface, layout, cells, sampling)
    form_is_separate = not tiles.in_order or bool(case.seal.form)
    if length is None:  # the shape of the seal determines its size
        return SealSize(sampling, tiles.size, form_is_separate)
    cell_length = cut.size[1]
    if length < cell_length * (1 - 1e-9):
        expected = f"at least the length of a cell, {to_text(cell_length, 'm', 3)}"
        raise InputError("stochastic.length", to_text(length, "m", 3), expected)
    breadth = table.breadth or surface.size[0]
    return SealSize(sampling, (breadth, length), form_is_separate)


@dataclass(frozen=True)
class StochasticInput:
    """Input of the stochastic study, including the form deviations or the pressure map of the seal.

    sampling : options of the stochastic study.
    cells : numbers of cells of the surface along x1 and x2.
    warnings : warnings about the tiles and the pressure map.
    """

    sampling: Sampling
    cells: Shape
    warnings: tuple[str, ...]


def add_forms_or_pressure_map(
    case: Case,
    scene: Scene,
    sampling: Sampling,
    cells: Shape | None,
    size: Pair,
    seat: Seat | None,
) -> StochasticInput:
    """Add the form deviations of the seal, or else the pressure map of the case, to the options of the study.

    Raises InputError if a form is too steep, or if the forms or the pressure map do not cover the seal.

    size : width and length of the seal [m].
    seat : seat that is a form deviation of the whole seal; None for a flat seat, and for a seat whose heights were
        added to the heights of the surface.
    """
    forms: tuple[SealForm, ...] = tuple(table.make(case.folder) for table in case.seal.form or ())
    if seat is not None:
        forms += (seat,)
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
        return StochasticInput(
            sampling=sampling, cells=cut.shape, warnings=(*tiles.warnings, *map_warnings)
        )


def form_tolerance(
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
