"""Plans of transforms that are the same in every process: FFTW chooses them by timing, so that its choice is kept.

What FFTW chose is text, its wisdom. Every transform has its own, and is planned with no other about: what FFTW makes of
wisdom depends on all that it has. Plans made from the same wisdom give the same bits. It is taken from, in this order,

1. the plans that came with a half-space from another process, or with the checkpoint of a run (`restored`),
2. this process,
3. the folder FEMSEAL_CACHE, else XDG_CACHE_HOME/femseal or ~/.cache/femseal, by FFTW library and processor,
4. a measurement, which is written there; one process at a time measures.

Where that folder cannot be written, what is not in it is planned by FFTW's estimate, the same in every process too, but
slower by up to a third on small grids and two thirds on large ones.
"""

from __future__ import annotations

import hashlib
import logging
import os
import platform
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pyfftw

from ..base.files import replacing

try:
    import fcntl
except ImportError:  # not on Windows, where several processes may measure at a time
    fcntl = None  # type: ignore[assignment]

log = logging.getLogger("femseal.plans")
#: Wisdom of transforms by their names; "" for an estimate.
Kept = tuple[tuple[str, str], ...]
#: So long a measurement of another process is awaited [s].
LOCK_SECONDS = 120.0
_PRECISIONS = ("float64", "float32", "longdouble")

_planning = threading.RLock()
_own: dict[str, str] = {}
_restored: Kept = ()


@dataclass(frozen=True)
class Transform:
    """A transform and its inverse between contiguous arrays.

    shape : of the real points, whose waves along the last of the axes are half as many and one; where points are
        complex, they are waves transformed in place. axes : that are transformed. dtype : name of the points' type.
    """

    shape: tuple[int, int]
    axes: tuple[int, ...]
    dtype: str
    threads: int = 1

    @property
    def name(self) -> str:
        """Of the wisdom, also as a file."""
        axes = "".join(map(str, self.axes))
        return f"{self.dtype}-{self.shape[0]}x{self.shape[1]}-axes{axes}-threads{self.threads}"

    def scratch(self) -> tuple[Any, Any]:
        """Points and waves to plan with."""
        points = pyfftw.empty_aligned(self.shape, dtype=self.dtype)
        if np.issubdtype(points.dtype, np.complexfloating):
            return points, points
        n1, n2 = self.shape
        return points, pyfftw.empty_aligned((n1, n2 // 2 + 1), dtype=np.result_type(points.dtype, np.complex64))

    def made(self, points: Any, waves: Any, target: Any, *flags: str) -> tuple[Any, Any]:
        """FFTW's plans points → waves and, destroying them, waves → target; RuntimeError where FFTW makes none."""
        forward = pyfftw.FFTW(points, waves, self.axes, "FFTW_FORWARD", flags, self.threads)
        flags += ("FFTW_DESTROY_INPUT",)
        return forward, pyfftw.FFTW(waves, target, self.axes, "FFTW_BACKWARD", flags, self.threads)

    def from_wisdom(self, text: str, points: Any, waves: Any, target: Any) -> tuple[Any, Any]:
        """The plans of this wisdom, nothing measured; RuntimeError where it does not contain them."""
        with _no_other_wisdom():
            if not text:
                return self.made(points, waves, target, "FFTW_ESTIMATE")
            pyfftw.import_wisdom(tuple(text.encode() if p == self._precision else b"" for p in _PRECISIONS))
            return self.made(points, waves, target, "FFTW_MEASURE", "FFTW_WISDOM_ONLY")

    def measured(self) -> str:
        """Wisdom of plans that are timed now."""
        points, waves = self.scratch()
        with _no_other_wisdom():
            self.made(points, waves, points, "FFTW_MEASURE")
            return pyfftw.export_wisdom()[_PRECISIONS.index(self._precision)].decode()

    @property
    def _precision(self) -> str:
        return np.zeros(0, self.dtype).real.dtype.name


def planned(transform: Transform, points: Any, waves: Any, target: Any, given: Kept = ()) -> tuple[Any, Any]:
    """Plans points → waves and, destroying them, waves → target; of the wisdom `given` where that has it."""
    with _planning:
        text = wisdom(transform, given)
        try:
            return transform.from_wisdom(text, points, waves, target)
        except RuntimeError:
            log.warning(
                "the plan of %s was made for another processor or FFTW: its estimate is taken, last digits may differ",
                transform.name,
            )
            return transform.from_wisdom("", points, waves, target)


def wisdom(transform: Transform, given: Kept = ()) -> str:
    """The wisdom of a transform, measured if it is nowhere."""
    name = transform.name
    with _planning:
        text = dict(given).get(name, _own.get(name))
        if text is None:
            text = _own[name] = _from_folder(transform)
        return text


def preferred(given: Kept) -> Kept:
    """The plans given, or those restored where none are."""
    return given or _restored


def known() -> dict[str, str]:
    """Every wisdom used in this process that did not come with a half-space."""
    return {**_own, **dict(_restored)}


@contextmanager
def restored(kept: dict[str, str]) -> Iterator[None]:
    """These plans are used meanwhile by this process, and by others that get half-spaces from it."""
    global _restored
    before, _restored = _restored, tuple(sorted(kept.items()))
    try:
        yield
    finally:
        _restored = before


@contextmanager
def _no_other_wisdom() -> Iterator[None]:
    with _planning:
        kept = pyfftw.export_wisdom()
        pyfftw.forget_wisdom()
        try:
            yield
        finally:
            pyfftw.forget_wisdom()
            pyfftw.import_wisdom(kept)


def _from_folder(transform: Transform) -> str:
    try:
        folder = _folder()
        path = folder / f"{transform.name}.wisdom"
        if (text := _read(path, transform)) is not None:
            return text
        folder.mkdir(parents=True, exist_ok=True)
        with _locked(folder / "lock"):
            if (text := _read(path, transform)) is not None:
                return text
            text = transform.measured()
            with replacing(path) as temporary:
                temporary.write_text(f"{_checksum(text)}\n{text}", encoding="ascii", newline="")
            return text
    except OSError as error:
        _warn_once(error.strerror or str(error))
        return ""


def _read(path: Path, transform: Transform) -> str | None:
    """Wisdom in a file, None where there is none that can be used."""
    try:
        checksum, text = path.read_text(encoding="ascii").split("\n", 1)
    except (FileNotFoundError, ValueError):
        return None
    if checksum != _checksum(text):
        return None
    points, waves = transform.scratch()
    try:
        transform.from_wisdom(text, points, waves, points)
    except RuntimeError:
        return None
    return text


def _checksum(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()


@contextmanager
def _locked(path: Path) -> Iterator[None]:
    """The file locked against other processes; after a time, or where that cannot be, without."""
    with path.open("a") as file:  # the lock ends with the file or the process
        end = time.monotonic() + LOCK_SECONDS
        while fcntl is not None:
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                break
            except BlockingIOError:
                if time.monotonic() > end:
                    break
                time.sleep(0.02)
            except OSError:  # a file system without locks
                break
        yield


@cache
def _warn_once(reason: str) -> None:
    reason = f"{reason}; FEMSEAL_CACHE can name a folder"
    log.warning("plans of transforms cannot be kept (%s): FFTW's estimates are taken, which are slower", reason)


def _folder() -> Path:
    """Of this FFTW library on this kind of processor; OSError where the user has no home."""
    if given := os.environ.get("FEMSEAL_CACHE"):
        root = Path(given)
    elif given := os.environ.get("XDG_CACHE_HOME"):
        root = Path(given, "femseal")
    else:
        try:
            root = Path.home() / ".cache" / "femseal"
        except RuntimeError as error:
            raise OSError(str(error)) from error
    return root / f"fftw-{_library()}"


@cache
def _library() -> str:
    """Digest of what wisdom depends on: FFTW with its parts for this processor, pyFFTW, the processor."""
    with _no_other_wisdom():
        headers = pyfftw.export_wisdom()
    parts = (*headers, pyfftw.__version__.encode(), _processor().encode())
    return hashlib.sha256(b"\n".join(parts)).hexdigest()[:16]


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        lines = []
    names = (line.split(":", 1)[1].strip() for line in lines if line.startswith("model name"))
    return next(names, platform.processor() or platform.machine())
