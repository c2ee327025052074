"""Tables of the rough faces in a case file, and of the conditioning of their sum.

To add a kind of face, write a table with `make` and put it into `Face`.
"""

from __future__ import annotations

import glob
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BeforeValidator, Field, WithJsonSchema

from ..base import InputError, shortened
from ..topography import SPIKES, Instrument, Topography, read_measured, self_affine, turned
from .faults import fault, refusal
from .values import (
    Angle,
    Both,
    Channel,
    Count,
    Height,
    Hurst,
    Length,
    Place,
    Ratio,
    Shift,
    Slope,
    Table,
    Threshold,
    Usual,
)

#: Sides and pixels of a face, and heights and waves on it.
Side = Annotated[Length, Usual(1e-7, 1.0, "m")]
Pixel = Annotated[Length, Usual(1e-10, 1e-3, "m")]
Wave = Annotated[Length, Usual(1e-9, 0.1, "m")]
Relief = Annotated[Length, Usual(1e-10, 1e-3, "m")]


class SelfAffineFace(Table):
    """A self-affine face, see `topography.self_affine`."""

    kind: Literal["self-affine"]
    points: tuple[Count, Count]
    size: tuple[Side, Side]
    hurst: Hurst = 0.8
    rms_slope: Slope | None = None
    rms_height: Relief | None = None
    roll_off: Wave | None = None
    cut_off: Wave | None = None

    def make(self, folder: Path, rng: np.random.Generator) -> tuple[Topography, Instrument]:
        """The face, which no instrument limits."""
        given = self.model_dump(exclude={"kind", "points", "size"})
        return self_affine(self.points, self.size, rng=rng, **given), Instrument()


class TurnedFace(Table):
    """A turned face, see `topography.turned`."""

    kind: Literal["turned"]
    points: tuple[Count, Count]
    size: tuple[Side, Side]
    pitch: Wave
    depth: Relief
    nose_radius: Wave | None = None
    feed_error: Ratio = 0.0
    depth_error: Ratio = 0.0
    waviness: Height = 0.0
    waviness_length: Wave | None = None
    roughness: Height = 0.0
    hurst: Hurst = 0.8
    roughness_roll_off: Wave | None = None
    cut_off: Wave | None = None

    def make(self, folder: Path, rng: np.random.Generator) -> tuple[Topography, Instrument]:
        """The face, which no instrument limits."""
        given = self.model_dump(exclude={"kind", "points", "size"})
        return turned(self.points, self.size, rng=rng, **given), Instrument()


def _part(value: Any) -> Any:
    if value is None or (
        isinstance(value, (list, tuple)) and len(value) == 4 and not any(isinstance(x, (list, tuple)) for x in value)
    ):
        return value
    raise refusal("four lengths in one list, x1 from and to, x2 from and to: ['0.1 mm', '0.9 mm', '0 mm', '0.5 mm']")


class MapFile(Table):
    """A file with a map of heights, see `topography.read_topography`; paths are relative to the case file."""

    path: Path | None = None
    size: tuple[Side, Side] | None = None
    spacing: Annotated[tuple[Pixel, Pixel], Both()] | None = None
    height_unit: str | None = None
    delimiter: str | None = None
    array: str | None = None
    channel: Channel = 0
    transpose: bool = False
    mask: Path | None = None
    file_mask: bool = True
    crop: Annotated[tuple[Place, Place, Place, Place] | None, BeforeValidator(_part)] = None
    periodic: Annotated[tuple[bool, bool], Both()] = (False, False)
    tip_radius: Wave | None = None
    resolution: Wave | None = None


def _tables(given: Any) -> Any:
    """Places as tables: a text is a path or a pattern of paths."""
    given = [given] if isinstance(given, str) else given
    return [{"path": one} if isinstance(one, str) else one for one in given] if isinstance(given, list) else given


#: Maps of several places: paths, a pattern of paths such as "place*.plu", or tables with keys of their own.
PlaceTables = Annotated[
    tuple[MapFile, ...], BeforeValidator(_tables), WithJsonSchema({"type": ["string", "array"], "items": {}})
]


class FileFace(MapFile):
    """A measured face: one map, or `places`, several of them.

    Keys of the table are those of every place that has none of its own. `mirror`, `rotate` and `shift` place the second
    of two faces on the first, see `topography.combine`.
    """

    kind: Literal["file"]
    places: PlaceTables | None = None
    mirror: Literal["x1", "x2"] | None = None
    rotate: Angle | None = None
    shift: tuple[Shift, Shift] | None = None

    @property
    def placement(self) -> dict[str, Any]:
        """Placement on the first face, as `topography.combine` takes it."""
        return self.model_dump(include=_PLACEMENT, exclude_none=True)

    def each(self, folder: Path) -> list[FileFace]:
        """The tables of all places, patterns resolved in alphabetical order; the face itself where it is one map.

        Raises PydanticCustomError: no file, or one besides places, or fewer than two places.
        """
        if self.places is None:
            if self.path is None:
                raise fault("face.path", "none", "the file of the map, or places")
            return [self]
        if self.path is not None:
            raise fault("face.path", "a file besides places", "one of them")
        found = []
        for place in self.places:
            if place.path is None:
                raise fault("face.places", "a place without path", "a path in every place")
            name, own = str(place.path), {key: getattr(place, key) for key in place.model_fields_set}
            paths = [place.path]
            if glob.has_magic(name) and "\0" not in name:
                paths = [Path(path) for path in sorted(glob.glob(name, root_dir=folder))]
            found += [self.model_copy(update={**own, "places": None, "path": path}) for path in paths]
        if len(found) < 2:
            names = ", ".join(str(place.path) for place in self.places)
            given = f"'{shortened(names)}', which is {'one file' if found else 'no file'}"
            raise fault("face.places", given, "at least two; path for a single one")
        if (twice := [table for n, table in enumerate(found) if table in found[:n]]) != []:
            raise fault("face.places", f"'{shortened(twice[0].path)}' twice", "each place once")
        return found

    def make(self, folder: Path, rng: np.random.Generator) -> tuple[Topography, Instrument]:
        """The face, of one map, and its instrument."""
        given = self.model_dump(exclude={"kind", "path", "places", "mask", *_PLACEMENT})
        path, mask = folder / (self.path or ""), None if self.mask is None else folder / self.mask
        try:
            return read_measured(path, mask=mask, **given)
        except InputError as error:  # of a file, which it names
            keys = (f"{key}, " for key, file in (("path", path), ("mask", mask)) if error.what.startswith(str(file)))
            raise InputError(next(keys, "") + error.what, error.given, error.expected) from None


_PLACEMENT = {"mirror", "rotate", "shift"}
Face = Annotated[SelfAffineFace | TurnedFace | FileFace, Field(discriminator="kind")]


class SurfaceTable(Table):
    """Repair of measured faces (`topography.repair`) and conditioning of their sum (`topography.condition`).

    continue_spectrum : cut-off of the waves that continue its power law, see `topography.continue_spectrum`.
    """

    spikes: Threshold = SPIKES
    detrend: Literal[0, 1, 2] = 1
    shortest_wave: Wave | None = None
    max_undefined: Ratio = 0.05
    points: tuple[Count, Count] | None = None
    continue_spectrum: Wave | None = None
