"""Define the tables [face] and [surface] of a case.

[face] describes a rough surface, generated or measured. [surface] describes how the sum of both surfaces is
conditioned. To add a kind of face, write a table with the methods `maps` and `make`, and add it to `Face`.
"""

from __future__ import annotations

import glob
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, NamedTuple

import numpy as np
from pydantic import BeforeValidator, Field, WithJsonSchema

from ..base import FileError, InputError, shortened
from ..topography import (
    SPIKES,
    Instrument,
    Topography,
    read_measured,
    resolved_wave,
    self_affine,
    turned,
)
from .faults import invalid_value
from .quantity_types import (
    Angle,
    Channel,
    Count,
    Fraction,
    Height,
    Hurst,
    Length,
    OneForBothAxes,
    Position,
    Shift,
    Slope,
    Threshold,
    UsualRange,
)
from .table_types import Table, key

#: Types of lengths that differ in their usual range: side of a surface, size of a pixel, wavelength, height of
#: roughness.
Side = Annotated[Length, UsualRange(1e-7, 1.0, "m")]
Pixel = Annotated[Length, UsualRange(1e-10, 1e-3, "m")]
Wave = Annotated[Length, UsualRange(1e-9, 0.1, "m")]
Relief = Annotated[Length, UsualRange(1e-10, 1e-3, "m")]


class FaceMap(NamedTuple):
    """A map of heights, the limits of its instrument, and notes on how its file was interpreted."""

    topography: Topography
    instrument: Instrument
    notes: tuple[str, ...] = ()


_CUT_OFF = "shortest wave of the roughness; by default 8 pixels"


class GeneratedFace(Table):
    """Base class of all surfaces that are generated from random numbers."""

    make_heights: ClassVar[Callable[..., Topography]]
    points: tuple[Count, Count] = key("number of points along x1 and x2", start=[256, 512])
    size: tuple[Side, Side] = key("length along x1 and x2", start=["240 um", "480 um"])
    hurst: Hurst = key("Hurst exponent of the roughness", 0.8)
    ra: Relief | None = key(
        "Ra on the drawing; `femseal check` compares the surface with it",
        None,
        example="1.6 um",
        since="0.3",
    )
    rz: Relief | None = key(
        "Rz on the drawing; `femseal check` compares the surface with it",
        None,
        example="8 um",
        since="0.3",
    )
    if TYPE_CHECKING:
        cut_off: float | None

    def maps(self, folder: Path) -> list[GeneratedFace]:
        """Return the table of each map of the face. A generated surface is a single map."""
        return [self]

    def make(self, folder: Path, rng: np.random.Generator) -> FaceMap:
        """Generate the surface, and store the wavelength of its shortest wave as `Instrument.generated_wave`."""
        parameters = self.model_dump(exclude={"kind", "points", "size", "ra", "rz"})
        heights = type(self).make_heights(self.points, self.size, rng=rng, **parameters)
        shortest_wave = self.cut_off or resolved_wave(self.size, self.points)
        return FaceMap(heights, Instrument(generated_wave=shortest_wave))


class SelfAffineFace(GeneratedFace):
    """A self-affine surface, see `topography.self_affine`."""

    make_heights = staticmethod(self_affine)
    kind: Literal["self-affine"]
    rms_slope: Slope | None = key("rms slope of the surface", None, example=0.2)
    rms_height: Relief | None = key(
        "rms height of the surface", None, example="1 um", instead="rms_slope"
    )
    roll_off: Wave | None = key(
        "longest wave of the power law of the spectrum", None, example="60 um"
    )
    cut_off: Wave | None = key(_CUT_OFF, None, example="7.5 um")


class TurnedFace(GeneratedFace):
    """A turned surface, see `topography.turned`."""

    make_heights = staticmethod(turned)
    kind: Literal["turned"]
    pitch: Wave = key("feed per turn", start="60 um")
    depth: Relief = key("height of the ridges", start="2.5 um")
    nose_radius: Wave | None = key(
        "nose radius of the tool; where neighbouring grooves do not meet, the surface between "
        "them is flat",
        None,
        example="0.4 mm",
    )
    feed_error: Fraction = key("rms scatter of the feed, divided by the pitch", 0.0, start=0.03)
    depth_error: Fraction = key(
        "rms scatter of the depth of the grooves, divided by their depth", 0.0, start=0.1
    )
    waviness: Height = key("rms height of a long wave along x1", 0.0, example="0.2 um")
    waviness_length: Wave | None = key("length of the long wave", None, example="120 um")
    roughness: Height = key(
        "rms height of a self-affine roughness that is added", 0.0, start="0.8 um"
    )
    roughness_roll_off: Wave | None = key(
        "longest wave of the power law of the spectrum of the roughness", None, start="40 um"
    )
    cut_off: Wave | None = key(_CUT_OFF, None, example="7.5 um")


def _check_crop(value: Any) -> Any:
    """Check that the value of the key `crop` is a flat list of four values, and return it."""
    if value is None:
        return value
    is_list = isinstance(value, (list, tuple))
    if is_list and len(value) == 4 and not any(isinstance(end, (list, tuple)) for end in value):
        return value
    raise invalid_value(
        "a list of four lengths, start and end along x1, then start and end along x2: "
        "['0.1 mm', '0.9 mm', '0 mm', '0.5 mm']"
    )


class MapFile(Table):
    """A file with a map of heights, see `topography.read_topography`; paths are relative to the case file."""

    path: Path | None = key(
        "file of heights, relative to the case: .npy .npz .csv .asc .txt .xyz .x3p .sdf, and "
        "more formats after `pip install 'femseal[surface]'`",
        None,
        example="face.plu",
    )
    size: tuple[Side, Side] | None = key(
        "size along x1 and x2, if the file contains no size or a wrong one",
        None,
        example=["1.2 mm", "0.9 mm"],
    )
    spacing: Annotated[tuple[Pixel, Pixel], OneForBothAxes()] | None = key(
        "size of a pixel along x1 and x2", None, example=["1 um", "2 um"], instead="size"
    )
    height_unit: str | None = key(
        "unit of the heights, if the file contains no unit or a wrong one", None, example="um"
    )
    delimiter: str | None = key(
        "character between the numbers of a text file, if it is not recognised", None, example=";"
    )
    array: str | None = key(
        "name of the array of heights in an `.npz` file", None, example="heights"
    )
    channel: Channel = key("number or name of the channel, if the file has several", 0)
    transpose: bool = key("whether x and y of the file are exchanged", False)
    mask: Path | None = key(
        "image, text or `.npy` file of the size of the map; points where it is not 0 (black) "
        "become undefined",
        None,
        example="mask.png",
    )
    file_mask: bool = key(
        "whether points that are masked in a `.gwy` or `.npz` file become undefined", True
    )
    no_data: float | Literal["none"] | None = key(
        "number that stands for points without a height; by default it is recognised; `none`: "
        "all numbers are heights",
        None,
        example=-9999,
        since="0.3",
    )
    verify_checksum: bool = key("whether an `.x3p` file with a wrong checksum is rejected", True)
    crop: Annotated[
        tuple[Position, Position, Position, Position] | None, BeforeValidator(_check_crop)
    ] = key(
        "part of the map that is used: start and end along x1, then start and end along x2",
        None,
        example=["0.1 mm", "0.9 mm", "0 mm", "0.5 mm"],
    )
    periodic: Annotated[tuple[bool, bool], OneForBothAxes()] = key(
        "whether the heights repeat along x1 and x2", (False, False)
    )
    tip_radius: Wave | None = key(
        "radius of the tip of the stylus; by default, the radius in the file; waves that the tip "
        "cannot follow are removed",
        None,
        example="2 um",
        since="0.3",
    )
    resolution: Wave | None = key(
        "lateral period limit of the instrument (ISO 25178-600)", None, example="1 um", since="0.3"
    )


def _patch_tables(value: Any) -> Any:
    """Convert a list of paths, or a pattern of paths, to a list of tables; items that are tables are not changed."""
    items = [value] if isinstance(value, str) else value
    if not isinstance(items, list):
        return value
    return [{"path": item} if isinstance(item, str) else item for item in items]


#: Maps of several patches, which are paths, a pattern such as "patch*.plu", or tables.
PatchTables = Annotated[
    tuple[MapFile, ...],
    BeforeValidator(_patch_tables),
    WithJsonSchema({"type": ["string", "array"], "items": {}}),
]


class FileFace(MapFile):
    """A measured surface: one map, or several `patches`.

    The keys of the table [face] apply to all patches. A table for a single patch can replace keys of the table [face].
    The keys `mirror`, `rotate` and `shift` position the second face on the first face, see `topography.combined`.
    """

    kind: Literal["file"]
    patches: PatchTables | None = key(
        "several measured patches: a list of files, a pattern of file names, or tables with "
        "their own keys",
        None,
        example=["a.plu", "b.plu", "c.plu"],
        since="0.2",
        instead="path",
    )
    mirror: Literal["x1", "x2"] | None = key(
        "axis along which the second face is reversed",
        None,
        example="x2",
        needed="of a second face",
    )
    rotate: Angle | None = key(
        "angle by which the second face is turned about its centre",
        None,
        example="5 deg",
        needed="of a second face",
    )
    shift: tuple[Shift, Shift] | None = key(
        "shift of the centre of the second face along x1 and x2",
        None,
        example=["0 um", "20 um"],
        needed="of a second face",
    )

    @property
    def placement(self) -> dict[str, Any]:
        """Position of the second face on the first face, as arguments of `topography.combined`."""
        return self.model_dump(include=_PLACEMENT, exclude_none=True)

    def maps(self, folder: Path) -> list[FileFace]:
        """Return a table for each map of the face: one table for each patch, or the table itself without patches.

        A pattern of paths is replaced by the files that match it, in alphabetical order.

        Raises
        ------
        InputError : the table has both `path` and `patches`, or neither; or `patches` contains fewer than two patches.
        """
        if self.patches is None:
            if self.path is None:
                raise InputError("face.path", "nothing", "the file of the map, or patches")
            return [self]
        if self.path is not None:
            raise InputError("face.path", "a file besides patches", "either a file or patches")
        maps = [
            self._patch(patch, path) for patch in self.patches for path in _paths_of(patch, folder)
        ]
        if len(maps) < 2:
            names = ", ".join(str(patch.path) for patch in self.patches)
            count = "one file" if maps else "no file"
            given = f"'{shortened(names)}', which is {count}"
            raise InputError(
                "face.patches", given, "at least two patches; for a single map, use path"
            )
        return maps

    def _patch(self, patch: MapFile, path: Path) -> FileFace:
        """Return the table of a patch, whose keys replace keys in the table of the face."""
        keys = {name: getattr(patch, name) for name in patch.model_fields_set}
        return self.model_copy(update={**keys, "patches": None, "path": path})

    def make(self, folder: Path, rng: np.random.Generator) -> FaceMap:
        """Read the surface, which is a single map.

        Raises
        ------
        InputError : the file or the mask cannot be read; the message contains the key and the path.
        """
        arguments = self.model_dump(exclude={"kind", "path", "patches", "mask", *_PLACEMENT})
        path = folder / (self.path or "")
        mask = None if self.mask is None else folder / self.mask
        try:
            measured = read_measured(path, mask=mask, **arguments)
        except FileError as error:
            name = "path" if error.path == path else "mask"
            raise InputError(f"{name}, {error.what}", error.given, error.expected) from None
        notes = tuple(f"{path.name}: {note}" for note in measured.notes)
        return FaceMap(measured.topography, measured.instrument, notes)


def _paths_of(patch: MapFile, folder: Path) -> list[Path]:
    """Return the path of a patch; if the path is a pattern, return all paths that match it."""
    if patch.path is None:
        raise InputError(
            "face.patches", "a patch without path", "the key `path` in the table of each patch"
        )
    pattern = str(patch.path)
    if glob.has_magic(pattern) and "\0" not in pattern:
        return [Path(path) for path in sorted(glob.glob(pattern, root_dir=folder))]
    return [patch.path]


#: Keys that position the second face on the first one.
_PLACEMENT = {"mirror", "rotate", "shift"}
Face = Annotated[TurnedFace | SelfAffineFace | FileFace, Field(discriminator="kind")]


class SurfaceTable(Table):
    """Repair of measured surfaces and conditioning of the sum of both faces, see `topography.conditioning`."""

    spikes: Threshold = key(
        "isolated points of files that deviate by more than this number of robust standard "
        "deviations are replaced; `inf`: none",
        SPIKES,
    )
    detrend: Literal[0, 1, 2] | None = key(
        "form that is removed: 0: mean, 1: also tilt, 2: also curvature; by default 0 for "
        "generated surfaces, 1 for measured ones, and 2 for measured ones with a curved "
        "`[seat]`",
        None,
        example=2,
    )
    shortest_wave: Wave | None = key(
        "shortest wave that the low-pass filter keeps; by default 8 pixels, or the shortest "
        "measured wave of a file",
        None,
        example="8 um",
    )
    max_undefined: Fraction = key(
        "largest fraction of undefined points that is accepted; they are filled", 0.05
    )
    points: tuple[Count, Count] | None = key(
        "number of points of the grid along x1 and x2; by default, a measured surface has 8 "
        "points per shortest measured wave",
        None,
        example=[512, 1024],
    )
    continue_spectrum: Wave | None = key(
        "waves down to this length are added to the measured ones; they follow the power law "
        "of the spectrum and have random phases",
        None,
        example="1 um",
        since="0.2",
    )
