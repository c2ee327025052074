"""Sizes of a case checked against the free memory before anything is made."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from math import prod

from ..base.errors import InputError
from ..base.machine import free_memory

#: Memory of the libraries that a run imports [byte].
START_MEMORY = 0.5e9
#: Memory that a point of a face takes at least while faces are made, low-passed and resampled [byte].
_POINT_BYTES = 64
#: Memory of a link of a drawn seal: its permeabilities at one step and a row of the solver [byte].
_LINK_BYTES = 8 * 32


def check_memory_of_points(key: str, shape: tuple[int, int]) -> None:
    """Raise InputError if a face of so many points does not fit into the free memory."""
    check_memory(key, f"{shape[0]} × {shape[1]} points", prod(shape) * _POINT_BYTES)


def check_memory_of_draws(
    steps: int, seal: tuple[int, int], realisations: int, library_cells: int, paths: int = 1
) -> None:
    """Raise InputError if drawn seals, their leakages, or the curves of a library do not fit into the free memory.

    paths : of pressure, for each of which every library window has its own curve.
    """
    check_memory("stochastic.length", f"a seal of {seal[0]} × {seal[1]:.4g} windows", prod(seal) * _LINK_BYTES)
    check_memory("stochastic.realisations", realisations, 16 * steps * realisations)
    check_memory("stochastic.library_cells", library_cells, 48 * steps * library_cells * paths)


def check_memory(key: str, given: object, needed: int) -> None:
    """Raise InputError, which names a key and its value, if so many bytes are not free."""
    if needed > (free := free_memory()):
        expected = f"what fits into the {free / 1e9:.3g} GB of free memory; it takes about {needed / 1e9:.3g} GB"
        raise InputError(key, given, expected)


@contextmanager
def refused_if_too_large() -> Iterator[None]:
    """Sizes that no array can have, or numbers that no float can hold, are bad input."""
    try:
        yield
    except (MemoryError, OverflowError, RecursionError) as error:
        expected = f"sizes that fit into memory and numbers of usual size ({str(error) or type(error).__name__})"
        raise InputError("case", "a size or number that is too large", expected) from error
