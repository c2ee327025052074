"""Deformed gap and contact pressure of a face at every step of a load programme, stitched from its windows.

The gap is kept at every pixel. The contact pressure is kept only where there is contact: a bit for every pixel says
whether it is in contact, and a number for each pixel in contact is its pressure.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.lib.mixins import NDArrayOperatorsMixin
from numpy.typing import NDArray

from ..base.shared_array import lies_on_disk, put_aside
from ..base.text import Shown
from ..loads import LoadProgramme
from .partition import Partition


@dataclass(frozen=True, eq=False)
class ContactValues:
    """A field (n1, n2) that is 0 out of contact.

    bits : 1 for each pixel where the field is not 0, eight pixels in a byte, row after row.
    values : the values at these pixels in the same order; a single one if all are the same.
    """

    shape: tuple[int, int]
    bits: NDArray[np.uint8]
    values: NDArray[np.float32]

    @classmethod
    def of(cls, values: NDArray[Any]) -> ContactValues:
        """Keep the values of an array (n1, n2)."""
        single = np.asarray(values, np.float32)
        inside = single != 0
        return cls((single.shape[0], single.shape[1]), np.packbits(inside), single[inside])

    @classmethod
    def constant(cls, shape: tuple[int, int], value: float) -> ContactValues:
        """A field with the same value at every pixel, such as NaN."""
        bits = np.packbits(np.full(shape, value != 0))
        return cls(shape, bits, np.full(1 if value != 0 else 0, value, np.float32))

    @classmethod
    def put_aside(cls, fields: Sequence[ContactValues], beside: NDArray[Any]) -> tuple[ContactValues, ...]:
        """The fields, together in two files where an array as large as `beside` lies in one."""
        if not lies_on_disk(beside.nbytes):
            return tuple(fields)
        bits, values = (
            np.split(put_aside(np.concatenate(parts)), np.cumsum([part.size for part in parts])[:-1])
            for parts in ([field.bits for field in fields], [field.values for field in fields])
        )
        return tuple(map(cls, (field.shape for field in fields), bits, values))

    def dense(self) -> NDArray[np.float32]:
        """The field as an array (n1, n2)."""
        full = np.zeros(self.shape, np.float32)
        full[np.unpackbits(self.bits, count=full.size).view(bool).reshape(self.shape)] = self.values
        return full


class ContactPressure(NDArrayOperatorsMixin):
    """Contact pressure (steps, n1, n2) [Pa] of all windows of a face, kept where there is contact.

    Use it like an array that cannot be changed. Indexing computes the indexed steps only; arithmetic, methods and
    numpy functions compute the whole field.

    partition : the cells of the face.
    windows : for every cell, row after row, its field at every step.
    """

    dtype = np.dtype(np.float32)
    ndim = 3

    def __init__(self, partition: Partition, windows: tuple[tuple[ContactValues, ...], ...]) -> None:
        self._partition, self._windows = partition, windows

    @property
    def shape(self) -> tuple[int, int, int]:
        """Number of steps, and pixels along x1 and x2."""
        return (len(self), *self._partition.shape)

    def __len__(self) -> int:
        return len(self._windows[0])

    def __iter__(self) -> Iterator[NDArray[np.float32]]:
        return (self._at(s) for s in range(len(self)))

    def __getitem__(self, key: Any) -> NDArray[np.float32]:
        key = key if isinstance(key, tuple) else (key,)
        if key and key[0] is not Ellipsis:
            steps, pixels = np.arange(len(self))[key[0]], key[1:]
        else:
            steps, pixels = np.arange(len(self)), key
        if steps.ndim == 0:
            return self._at(int(steps))[pixels]
        return np.array([self._at(int(s))[pixels] for s in steps], np.float32)

    def _at(self, step: int) -> NDArray[np.float32]:
        """The field over the whole face at one step."""
        face = np.empty(self._partition.shape, np.float32)
        for place, window in zip(self._partition.places, self._windows, strict=True):
            self._partition.cell(face, *place)[:] = window[step].dense()
        return face

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[Any]:
        return self[...].astype(dtype or self.dtype, copy=False)

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *inputs: Any, **options: Any) -> Any:
        arrays = (np.asarray(i) if isinstance(i, ContactPressure) else i for i in inputs)
        return getattr(ufunc, method)(*arrays, **options)

    def __getattr__(self, name: str) -> Any:
        # methods of an array, such as mean; a copy or a pickle that is not built yet has none
        if name.startswith("_"):
            raise AttributeError(name)
        return getattr(self[...], name)


@dataclass(frozen=True, eq=False, repr=False)
class WindowFields(Shown):
    """Deformed gap and contact pressure of a face along a load programme; neither can be changed.

    gap : (steps, n1, n2) [m], NaN in windows that failed; it is read-only.
    pressure : (steps, n1, n2) [Pa], used like an array, see `ContactPressure`.
    """

    steps: LoadProgramme
    partition: Partition = field(repr=False)
    gap: NDArray[np.float32] = field(metadata={"unit": "m", "long_name": "deformed gap stitched from the windows"})
    pressure: ContactPressure = field(metadata={"unit": "Pa", "long_name": "contact pressure of the windows"})

    def __post_init__(self) -> None:
        gap = self.gap.view()
        gap.flags.writeable = False
        object.__setattr__(self, "gap", gap)
