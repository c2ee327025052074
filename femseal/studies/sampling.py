"""Define the options of the stochastic study, and cover a seal with tiles according to them."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass, field, replace

from ..base import InputError, Shape, validate
from ..face.cut import Cut, usual_cells
from ..scene import Scene
from ..seal.form import SealForm
from ..seal.layouts import Layout
from ..seal.pressure_map import AnyMap, Uniform, is_uniform
from ..seal.tiles import CellSize, SealTiles
from ..topography import Surface

#: Smallest and largest number of realisations, if their number is not given.
FEWEST_BY_DEFAULT, MOST_BY_DEFAULT = 3, 200
#: Largest number of tiles for a seal that does not vary along its length. A longer seal is represented by a part of its
#: length. The leakage of such a part scatters by less than 1 %, except near closing.
MOST_TILES = 4000


@dataclass(frozen=True)
class Sampling:
    """Options of the stochastic study: size of the seal, realisations, and contact pressure over the seal.

    Parameters
    ----------
    length : float or None, m
        Length of a straight seal along x2, which is rounded to whole tiles; None for a seal whose layout defines the
        size, such as a ring.
    realisations : int, optional
        Number of realisations. By default, the stochastic study itself chooses a number that is sufficient for the 95 %
        interval, see `stochastic`.
    seed : int
        Seed of all random numbers.
    breadth : float, optional, m
        Width of a straight seal from inlet to outlet; by default, the width of the surface.
    pressure_map : optional
        Map of the ratio of the contact pressure to the nominal pressure over the seal, see `seal.pressure_map`.
    form : optional
        Form deviation of the whole seal, from which the pressure of each tile is computed: a form of `seal.form`, a
        seat such as `CrownedSeat`, or several forms and seats, whose heights are added.
    median_fields : bool
        Whether the result contains the fields of the realisation whose leakage is nearest to the median leakage.

    Raises
    ------
    InputError
        The number of realisations is below 1, the seed is not a whole number >= 0, the length or breadth is not above
        0, or both a pressure map and a form are given.

    Examples
    --------
    >>> Sampling(0.1, seed=1, breadth=2e-3).presses_evenly  # 0.1 m long, 2 mm wide
    True
    """

    length: float | None
    realisations: int | None = None
    _: KW_ONLY
    seed: int
    breadth: float | None = None
    pressure_map: AnyMap = field(default_factory=Uniform)
    form: tuple[SealForm, ...] = ()
    median_fields: bool = True

    def __post_init__(self) -> None:
        if self.realisations is not None:
            count = validate.count("realisations", self.realisations)
            object.__setattr__(self, "realisations", count)
        object.__setattr__(self, "seed", validate.count("seed", self.seed, least=0))
        forms = self.form if isinstance(self.form, tuple | list) else (self.form,)
        object.__setattr__(self, "form", tuple(forms))
        if self.form and not is_uniform(self.pressure_map):
            raise InputError(
                "form",
                "a form and also a pressure map",
                "either a form or a pressure map, because the form already determines the pressure",
            )
        for name in ("length", "breadth"):
            if getattr(self, name) is not None:
                validate.number(name, getattr(self, name), unit="m")

    @property
    def presses_evenly(self) -> bool:
        """Whether all tiles have the nominal pressure."""
        return is_uniform(self.pressure_map) and not self.form


def cut_and_cover(
    surface: Surface, layout: Layout, cells: Shape | None, sampling: Sampling
) -> tuple[Cut, SealTiles]:
    """Cut a surface into cells along x1 and x2, and cover the seal with tiles that are each as large as a cell.

    The cells stay in order if the seal is as wide as the surface and all tiles have the same pressure.

    cells : numbers of cells along x1 and x2; if None, the usual numbers are chosen, see `usual_cells`.

    Raises InputError if the cells are too small, and in the cases listed in `seal.layouts.Layout.lay_out`.
    """
    presses_evenly = sampling.presses_evenly
    most_tiles = MOST_TILES if presses_evenly else None

    def cut_and_lay_out(in_order: bool) -> tuple[Cut, SealTiles]:
        cut = Cut.of(surface, cells or usual_cells(surface, in_order=in_order))
        cell_size = CellSize(cut.size, cut.shape[0], sampling.length, sampling.breadth, most_tiles)
        tiles = layout.lay_out(cell_size)
        return cut, replace(tiles, in_order=tiles.in_order and presses_evenly)

    # The usual number of cells depends on whether the cells stay in order. The order is only known when the tiles are
    # laid out. First assume that the cells stay in order, and cut the surface again if they do not.
    cut, tiles = cut_and_lay_out(in_order=True)
    if cells or tiles.in_order:
        return cut, tiles
    return cut_and_lay_out(in_order=False)


def cut_and_tiles(scene: Scene, cells: Shape | None, sampling: Sampling) -> tuple[Cut, SealTiles]:
    """Cut the surface into cells, and cover the seal with tiles that are each as large as a cell.

    Raises InputError in the cases listed in the docstring of `stochastic`.
    """
    cut, tiles = cut_and_cover(scene.surface, scene.layout, cells, sampling)
    if scene.traps_liquid and not tiles.in_order:
        given = "'trapped' with a seal that takes cells from anywhere on the face"
        expected = "'acts' with this seal, or a seal that is as wide as the face and pressed evenly"
        raise InputError("fluid_pressure", given, expected)
    return cut, tiles


def usual_realisations(cells: Shape, tiles: SealTiles) -> int:
    """Return the number of realisations with which the median leakage is usually accurate enough.

    The leakage of a seal scatters less if the seal is larger compared with the surface. A large seal therefore needs
    fewer realisations than a small seal.

    cells : numbers of cells of the surface along x1 and x2.
    """
    area_ratio = tiles.count / (cells[0] * cells[1])  # of the seal to the surface
    count = MOST_BY_DEFAULT / max(area_ratio, 1.0)
    return round(min(max(count, FEWEST_BY_DEFAULT), MOST_BY_DEFAULT))


def uses_tabulated_pressures(scene: Scene, sampling: Sampling) -> bool:
    """Return whether a seal with cells at random needs permeabilities at tabulated pressures."""
    return scene.acting_fluid is not None or not sampling.presses_evenly
