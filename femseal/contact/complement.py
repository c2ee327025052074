"""Gap and contact pressure of many steps in one array.

At a point one of the two is zero, so that gap − pressure holds both in half the memory.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.lib.mixins import NDArrayOperatorsMixin
from numpy.typing import NDArray


def gap_part(difference: NDArray[Any]) -> NDArray[Any]:
    """The gap, of gap − pressure."""
    return np.maximum(difference, 0)


def pressure_part(difference: NDArray[Any]) -> NDArray[Any]:
    """The contact pressure, of gap − pressure."""
    return np.abs(np.minimum(difference, 0))


class FieldOverSteps(NDArrayOperatorsMixin):
    """A field (steps, n1, n2) that is worked out of another where it is looked at.

    To be used like an array; indexing works out no more than what is asked for, all else the whole field.
    """

    def __init__(self, stored: NDArray[Any], part: Callable[[NDArray[Any]], NDArray[Any]]) -> None:
        self.stored, self._part = stored, part

    @property
    def shape(self) -> tuple[int, ...]:
        """Steps and pixels."""
        return self.stored.shape

    @property
    def dtype(self) -> np.dtype[Any]:
        """Type of the values."""
        return self.stored.dtype

    def __getitem__(self, key: Any) -> NDArray[Any]:
        return self._part(self.stored[key])

    def __len__(self) -> int:
        return len(self.stored)

    def __iter__(self) -> Iterator[NDArray[Any]]:
        return (self[s] for s in range(len(self)))

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[Any]:
        return self[...].astype(dtype or self.dtype, copy=False)

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *inputs: Any, **options: Any) -> Any:
        arrays = (np.asarray(i) if isinstance(i, FieldOverSteps) else i for i in inputs)
        return getattr(ufunc, method)(*arrays, **options)

    def __getattr__(self, name: str) -> Any:
        # nothing of a copy or a pickle that is not built yet
        if name.startswith("_") or name == "stored":
            raise AttributeError(name)
        return getattr(np.asarray(self), name)
