"""Options of a drawn seal, and its tiles."""

from dataclasses import KW_ONLY, dataclass, field, replace

from ..base import InputError, Shape, validate
from ..face.pieces import Cut, usual_pieces
from ..seal.form import SealForm
from ..seal.layouts import Layout
from ..seal.pressure_map import AnyMap, Uniform, is_uniform
from ..seal.tiles import PieceSize, SealTiles
from ..topography import Topography

#: Fewest seals that are drawn, and most, where their number is not given.
FEWEST_SEALS, MOST_SEALS = 3, 200

#: Tiles of a seal that is alike all along from which on a part of it stands for the whole: seals of so many scatter by
#: less than a percent but near closing.
MOST_TILES = 4000


@dataclass(frozen=True)
class Sampling:
    """Options of a drawn seal.

    Parameters
    ----------
    length : of a straight seal along x2 [m], rounded to whole tiles; None where the layout has its own size.
    realisations : number of seals that are drawn; None draws as many as the band needs, see `stochastic`.
    seed : of all random numbers.
    breadth : of a straight seal from inlet to outlet [m]; that of the face unless given.
    pressure_map : contact pressure over the seal in fractions of the nominal one, see `seal.pressure_map`.
    form : of the whole seal, which gives the pressure of its tiles instead: a form of `seal.form`, or a seat such as
        `CrownedSeat`; forms of both faces add up.
    median_fields : also keep the fields of the seal whose leakage is nearest to the median.

    Raises
    ------
    InputError : a number of realisations below 1, a seed that is no whole number from 0, a length or breadth that is
        not > 0, both a map and a form.

    Examples
    --------
    >>> Sampling(0.1, seed=1, breadth=2e-3).presses_evenly  # 0.1 m long, 2 mm broad
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
            object.__setattr__(
                self, "realisations", validate.count("realisations", self.realisations)
            )
        object.__setattr__(self, "seed", validate.count("seed", self.seed, least=0))
        given = self.form if isinstance(self.form, tuple | list) else (self.form,)
        object.__setattr__(self, "form", tuple(given))
        if self.form and not is_uniform(self.pressure_map):
            raise InputError(
                "form", "a form and a map of the pressure", "one of them: a form gives the pressure"
            )
        for name in ("length", "breadth"):
            if getattr(self, name) is not None:
                validate.number(name, getattr(self, name), unit="m")

    @property
    def presses_evenly(self) -> bool:
        """Whether all tiles have the nominal pressure."""
        return is_uniform(self.pressure_map) and not self.form


def laid_out(
    surface: Topography, layout: Layout, pieces: Shape | None, sampling: Sampling
) -> tuple[Cut, SealTiles]:
    """The cut of a face into pieces along x1 and x2, and the tiles of the seal, each as large as a piece.

    pieces : None: as many as suit the seal, see `face.pieces.usual_pieces`. They stay in the rows of the face where the
    seal is as broad and pressed evenly.

    Raises InputError: pieces that are too small; see `seal.layouts.Layout.lay_out`.
    """
    even = sampling.presses_evenly
    most = MOST_TILES if even else None
    for in_place in (True, False):
        cut = Cut.of(surface, pieces or usual_pieces(surface, in_place=in_place))
        tiles = layout.lay_out(
            PieceSize(cut.size, cut.shape[0], sampling.length, sampling.breadth, most)
        )
        tiles = replace(tiles, in_place=tiles.in_place and even)
        if pieces or tiles.in_place:
            break
    return cut, tiles
