"""A field of a face at every step, made when it is used."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.lib.mixins import NDArrayOperatorsMixin
from numpy.typing import NDArray


class StepFields(NDArrayOperatorsMixin):
    """A field (steps, n1, n2) in single precision whose steps are made when they are used.

    Use it like an array that cannot be changed. Indexing makes the indexed steps only; arithmetic, methods and numpy
    functions make the whole field.

    shape : number of steps, and pixels along x1 and x2. at : gives the field (n1, n2) at the step of a number.
    """

    dtype = np.dtype(np.float32)
    ndim = 3

    def __init__(
        self, shape: tuple[int, int, int], at: Callable[[int], NDArray[np.float32]]
    ) -> None:
        self.shape, self._at = shape, at

    def __len__(self) -> int:
        return self.shape[0]

    def __iter__(self) -> Iterator[NDArray[np.float32]]:
        return map(self._at, range(len(self)))

    def __getitem__(self, key: Any) -> NDArray[np.float32]:
        key = key if isinstance(key, tuple) else (key,)
        if key and np.ndim(key[0]) > 1:  # a choice of pixels
            return self[...][key]
        if key and key[0] is not Ellipsis:
            steps, pixels = np.arange(len(self))[key[0]], key[1:]
        else:
            steps, pixels = np.arange(len(self)), key
        if steps.ndim == 0:
            return self._at(int(steps))[pixels]
        return np.array([self._at(int(s))[pixels] for s in steps], np.float32)

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[Any]:
        return self[...].astype(dtype or self.dtype, copy=False)

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *inputs: Any, **options: Any) -> Any:
        arrays = (np.asarray(i) if isinstance(i, StepFields) else i for i in inputs)
        return getattr(ufunc, method)(*arrays, **options)

    def __getattr__(self, name: str) -> Any:
        # methods of an array, such as mean; a copy or a pickle that is not built yet has none
        if name.startswith("_"):
            raise AttributeError(name)
        return getattr(self[...], name)
