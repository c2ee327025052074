"""Solve a surface that is too large to be pressed as a whole: blocks in their own contact, and their coarse heights.

Each block is a patch in its own place, without the waves that are longer than two cells. These longer waves are a form
of the whole surface, with one point for each cell, whose contact has the blocks as its rough layer. A cell takes its
permeability from the state of its block under its own pressure, less what a fluid carries there. The leakage is that of
the cells in their own order. Contact and flow need the memory of one block.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np

from ..base import Array, InputError, Mapper, Shape, Shown, Stage
from ..base.fields import CELL, STEP, declared
from ..checks import QuickEstimate, estimate_scene, result_warnings
from ..contact import HalfSpace
from ..face.cell_flow import Failed, SolveCounts
from ..face.cells import FEWEST_POINTS, Cut
from ..loads import LoadProgramme
from ..scene import Scene
from ..seal.tiles import face_tiles
from ..topography import Patches, Topography
from .cell_states import along_paths, cells_on_ladder, ladder_of
from .cells_in_order import flow_in_order
from .patch_state import PatchState
from .sampling import TileFluid
from .seal_contact import Cells, RoughLayer, opened, solved_steps

#: Cells of a block along each axis. Measured on 10 surfaces of 2 × 2 blocks: with 4 cells, the quartiles of the leakage
#: over that of the whole surface are 0.90 and 1.43. With 2 cells they are 0.79 and 1.33, and the end of a 95 % interval
#: is at a factor of 4.6 instead of 2.2.
CELLS = 4
#: Longest wave that a block keeps, in sides of a cell.
_LONGEST = 2.0
#: Spacing of the tabulated pressures of a block over the usual one. With 1, the leakage of four surfaces differs by
#: less than 2 % on loading, down to a hundredth of the first, and by less than 8 % on unloading, and takes 1.9 times as
#: long.
_RUNGS_APART = 2
#: Most points along a side of a block, unless the numbers of blocks are given.
_USUAL_POINTS = 1024


@dataclass(frozen=True, repr=False)
class BlocksResult(Shown):
    """Leakage of a surface that was solved by blocks, and its cells in their own order.

    Fields of cells are arrays (steps, rows, columns).

    Parameters
    ----------
    leakage : array (steps,), m²/s, NaN where a flow failed.
    counts : flows through cells of the blocks in their states.
    patch_state : contact states of the whole surface, from which the width of the interval follows.
    failures : reasons of values that are NaN.
    warnings : what is not plausible, one sentence each.
    quick_estimate : by the spectrum of the surface; None where that does not tell.
    """

    steps: LoadProgramme
    blocks: Shape
    leakage: Array = declared(
        "leakage_blocks", "m^2/s", "leakage per unit seal length, blocks", STEP, heading="blocks"
    )
    k1: Array = declared(
        "cell_k1", "m^3", "permeability of cells along x1, their sides closed", CELL
    )
    k2: Array = declared(
        "cell_k2", "m^3", "permeability of cells along x2, their sides closed", CELL
    )
    pressure: Array = declared("cell_pressure", "Pa", "contact pressure of cells", CELL)
    mean_gap: Array = declared("cell_mean_gap", "m", "mean gap of cells", CELL)
    counts: SolveCounts = field(default_factory=SolveCounts, repr=False)
    failures: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    patch_state: PatchState | None = field(default=None, repr=False)
    quick_estimate: QuickEstimate | None = field(default=None, repr=False)

    method: ClassVar[str] = "blocks"
    kind: ClassVar[str] = "by blocks"
    patches: ClassVar[None] = None

    @property
    def solvers(self) -> SolveCounts:
        """Number of systems by solver."""
        return self.counts

    @property
    def cells(self) -> BlocksResult:
        """The result, which is one of cells."""
        return self


def by_blocks(scene: Scene, blocks: Shape, *, mapper: Mapper = map) -> BlocksResult:
    """Solve a surface by blocks along x1 and x2.

    Parameters
    ----------
    scene : the surface, its load and its fluid.
    blocks : numbers of blocks. Each divides the number of points into a multiple of 4 cells.
    mapper : computes a stage for all blocks, such as the builtin `map`; it may use several processes or a cluster.

    Raises
    ------
    InputError : blocks that do not suit the points; several patches; trapped liquid; a spiral lay.
    NotConverged : a contact failed.

    Examples
    --------
    >>> import femseal as fs
    >>> face = fs.self_affine((64, 64), (64e-6, 64e-6), hurst=0.8, rms_slope=0.2, roll_off=20e-6, rng=1)
    >>> oil = fs.Liquid(1e-3)
    >>> scene = fs.Scene(face, 115e9, 3e9, oil, 1e6, 0.0, loading=(5e7,), fluid_pressure="ignored")
    >>> bool(by_blocks(scene, (2, 2)).leakage[0] > 0)
    True
    """
    check_blocks(scene, blocks)
    cut = []
    heights = np.empty((blocks[0] * CELLS, blocks[1] * CELLS))
    for at in np.ndindex(*blocks):
        block, _of_block(heights, at)[...] = _split(scene, blocks, at)
        cut.append(block)
    depth = heights.max() - heights
    layers = list(mapper(Stage("layers of the blocks", _layer), cut))
    pressure, separation, opening = _coarse_contact(scene, blocks, depth, layers)
    shape = blocks[0] * CELLS, blocks[1] * CELLS
    paths = [_of_block(pressure, at) for at in np.ndindex(*blocks)]
    found = list(mapper(Stage("cells of the blocks", _cells), zip(cut, paths, strict=True)))
    k = np.empty((*found[0][0].shape[:3], *shape))
    for at, (own, *_) in zip(np.ndindex(*blocks), found, strict=True):
        _of_block(k, at)[...] = own.reshape(*own.shape[:3], CELLS, CELLS)
    k += opened(separation, opening)
    state = _state_of(scene, [block for *_, block in found], separation + opening)
    fluid, tiles = TileFluid.of(scene), face_tiles(scene.surface.size, shape)
    leakage = np.full(len(scene.steps), np.nan)
    failed = dict(scene.separated_steps)
    for s in range(len(scene.steps)):
        if s in failed:
            continue
        through = flow_in_order(scene, tiles, k[:, :, s], fluid.pressures, fluid.piecewise)
        if isinstance(through, Failed):
            failed[s] = through.reason
        leakage[s] = through.per_length
    mean = k.mean(axis=0)
    mean_gap, estimate = separation + opening, estimate_scene(scene)
    return BlocksResult(
        scene.steps,
        blocks,
        leakage,
        mean[0],
        mean[1],
        pressure,
        mean_gap,
        counts=SolveCounts.total(counts for _, counts, _ in found),
        failures=tuple(f"{scene.steps[s].name}: {failed[s]}" for s in sorted(failed)),
        warnings=result_warnings(scene, leakage, mean_gap.mean(axis=(1, 2)), estimate),
        quick_estimate=estimate,
        patch_state=state,
    )


def check_blocks(scene: Scene, blocks: Shape) -> None:
    """Raise InputError if a scene cannot be solved by these blocks."""
    for points, count in zip(scene.surface.shape, blocks, strict=True):
        if count < 1 or points % (count * CELLS) or points // (count * CELLS) < FEWEST_POINTS:
            expected = f"numbers of which {CELLS} times divide the points into parts of at least {FEWEST_POINTS}"
            given = "{} × {} of {} × {} points".format(*blocks, *scene.surface.shape)
            raise InputError("blocks", given, expected)
    if isinstance(scene.surface, Patches):
        raise InputError("blocks", "several patches", "one face: each patch is solved by itself")
    if scene.traps_liquid:
        raise InputError("fluid_pressure", "'trapped' with blocks", "'acts'")
    if scene.flow.spiral is not None:
        raise InputError("lay", "a spiral with blocks", "grooves that do not wind")


def blocks_of(cells: Shape | None) -> Shape:
    """Return the numbers of blocks that have so many cells together.

    Raises InputError: numbers that are not multiples of the cells of a block.
    """
    if cells is None or any(m % CELLS for m in cells):
        raise InputError("cells", cells, f"multiples of {CELLS}, the cells of a block")
    return cells[0] // CELLS, cells[1] // CELLS


def usual_blocks(points: Shape) -> Shape:
    """Return the fewest blocks of at most 1024 points a side, whose cells have equal numbers of points."""
    found = []
    for n in points:
        suiting = (m for m in range(max(2, -(-n // _USUAL_POINTS)), n) if n % (m * CELLS) == 0)
        found.append(next(suiting, 2))
    return found[0], found[1]


def _split(scene: Scene, blocks: Shape, at: tuple[int, ...]) -> tuple[Scene, Array]:
    """Cut a block out of the surface, and split it into short and long waves.

    Returns the scene of the block with its short waves and mirrored sides, and the means of its long waves over its
    cells [m].
    """
    surface = scene.surface
    n1, n2 = (n // count for n, count in zip(surface.shape, blocks, strict=True))
    rows, columns = (slice(i * n, (i + 1) * n) for i, n in zip(at, (n1, n2), strict=True))
    cut = Topography(
        np.ascontiguousarray(surface.heights[rows, columns]), surface.spacing, (False, False)
    )
    long = cut.low_pass(_LONGEST * max(cut.size) / CELLS).heights
    means = long.reshape(CELLS, n1 // CELLS, CELLS, n2 // CELLS).mean(axis=(1, 3))
    return replace(
        scene, surface=cut.with_heights(cut.heights - long), boundary=("mirror", "mirror")
    ), means


def _of_block(values: Array, at: tuple[int, ...]) -> Array:
    """Select the values (…, CELLS, CELLS) of a block from those of all cells (…, rows, columns)."""
    rows, columns = (slice(i * CELLS, (i + 1) * CELLS) for i in at)
    return values[..., rows, columns]


def _layer(block: Scene) -> RoughLayer:
    """Solve the block as a rough layer."""
    return RoughLayer.of(block, map, block.boundary)


def _coarse_contact(scene: Scene, blocks: Shape, depth: Array, layers: list[RoughLayer]) -> Array:
    """Solve the contact of the coarse heights.

    Returns the pressure [Pa], the distance of the mean planes [m] and the opening [m] of every cell, an array (3,
    steps, rows, columns).
    """
    size = scene.surface.size
    spacing = size[0] / depth.shape[0], size[1] / depth.shape[1]
    body = HalfSpace(depth.shape, spacing, scene.modulus, scene.boundary)
    number = np.arange(len(layers)).reshape(blocks)
    layer = replace(
        layers[0],
        gap=np.concatenate([one.gap for one in layers]),
        recovered=np.concatenate([one.recovered for one in layers]),
        face=number.repeat(CELLS, axis=0).repeat(CELLS, axis=1).ravel(),
    )
    cells = Cells(body, np.ones(depth.shape, bool), depth.ravel(), float(layer.pressure[-1]))
    found = solved_steps(cells, scene.steps, layer)
    return found.reshape(3, len(scene.steps), *depth.shape)


def _cells(given: tuple[Scene, Array]) -> tuple[Array, SolveCounts, PatchState]:
    """Solve the cells of a block along their own pressures.

    Returns their permeabilities (pressures, 2, steps, cells), the numbers of solutions, and the states of the block.
    """
    block, pressure = given
    steps, cut, fluid = block.steps, Cut.of(block.surface, (CELLS, CELLS)), TileFluid.of(block)
    paths = fluid.effective(pressure.reshape(len(steps), -1))
    ladder = ladder_of(paths, steps, block.law.is_elastic, _RUNGS_APART)
    cells = cells_on_ladder(block, cut, ladder, map, block.boundary)
    own = np.arange(CELLS**2)
    k = fluid.own(along_paths(cells, paths, steps))[..., own, own]
    state = PatchState.of(steps, cells, paths.mean(axis=1), np.full(len(steps), np.nan))
    return k, cells.counts, state


def _state_of(scene: Scene, blocks: list[PatchState], gap: Array) -> PatchState:
    """Combine the states of blocks to those of the whole surface, assuming that each dissipates about as much.

    Parameters
    ----------
    scene : the whole surface.
    blocks : states of the blocks.
    gap : mean gap of the cells, array (steps, rows, columns), m.
    """
    inverse_carriers = [1 / np.nan_to_num(block.carriers, nan=1.0) for block in blocks]
    carriers = len(blocks) ** 2 / np.sum(inverse_carriers, axis=0)
    contact = np.mean([block.contact_fraction for block in blocks], axis=0)
    mean_gap = gap.mean(axis=(1, 2))
    open_leakage = scene.unit_leakage * mean_gap**3 / 12
    no_detours = np.zeros(len(carriers))  # cells of blocks stay in their order
    return PatchState(carriers, contact, no_detours, open_leakage)
