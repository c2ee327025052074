"""Check that the sizes of a case fit into the free memory, before any large array is created."""

from collections.abc import Iterator
from contextlib import contextmanager
from math import prod

from ..base import InputError, Shape, free_memory, to_text
from ..face.cut import Cut, usual_cells
from ..seal.covering import MOST_ROWS
from ..seal.layouts import AnnularLayout, Layout
from ..studies import Sampling
from ..topography import Surface

#: Memory of the libraries that a run imports [byte].
START_MEMORY = 0.5e9
#: Smallest memory for each point of a surface while it is generated, filtered and resampled [byte].
_POINT_BYTES = 64
#: Memory for each tile of a stochastic seal, including its element and its row in the linear system [byte].
_TILE_BYTES = 4000


@contextmanager
def refuse_impossible_sizes() -> Iterator[None]:
    """Raise an InputError if the computations in the `with` block fail because a size or a number is too large."""
    try:
        yield
    except (MemoryError, OverflowError, RecursionError) as error:
        reason = str(error) or type(error).__name__
        expected = f"sizes that fit into memory and numbers of usual size ({reason})"
        raise InputError("case", "a size or number that is too large", expected) from error


def check_memory(key: str, given: object, needed: float) -> None:
    """Raise InputError if the value of a key requires more memory than is free.

    key : key of the case, for the message.
    given : value of the key, for the message.
    needed : required memory [byte].
    """
    free = free_memory()
    if needed > free:
        expected = (
            f"what fits into the {free / 1e9:.3g} GB of free memory; it takes about "
            f"{needed / 1e9:.3g} GB"
        )
        raise InputError(key, given, expected)


def check_memory_of_points(key: str, shape: Shape, patches: int = 1) -> None:
    """Raise InputError if a surface does not fit into the free memory.

    key : key of the case, for the message.
    shape : numbers of points along x1 and x2 of all patches together.
    patches : number of patches.
    """
    together = f" of {patches} patches together" if patches > 1 else ""
    check_memory(key, f"{shape[0]} × {shape[1]} points{together}", prod(shape) * _POINT_BYTES)


def check_memory_of_tiles(layout: Layout, sampling: Sampling, surface: Surface) -> None:
    """Raise InputError if the tiles of a strip or a ring do not fit into memory.

    The number of tiles is estimated with the default size of the cells of the surface.
    """
    if isinstance(layout, AnnularLayout):
        key, length = "seal", layout.circumference
        breadth = layout.outer_radius - layout.inner_radius
    elif sampling.length is not None:
        key, length = "stochastic.length", sampling.length
        breadth = sampling.breadth or surface.size[0]
    else:
        return
    side1, side2 = Cut.of(surface, usual_cells(surface)).size
    rows, columns = breadth / side1, length / side2
    if rows > MOST_ROWS:  # `Layout.lay_out` raises a more specific error
        return
    tiles = rows * columns
    given = f"a seal {to_text(length, 'm', 3)} long, of {tiles:.3g} tiles"
    check_memory(key, given, tiles * _TILE_BYTES)
