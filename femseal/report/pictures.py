"""Pictures of a run: each is drawn once, for the folder as it is, and for the page panel by panel."""

from __future__ import annotations

import base64
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, cast

import numpy as np

from ..base import counted, to_text
from ..plots import heights_figure, leakage_figure, pieces_figure, seal_figure
from ..plots.drawing import HEIGHTS, LINES, Drawn, Sheet, drawn
from ..plots.drawn_panels import DrawnSeal, drawn_figure, part_text
from ..plots.heights import height_panel
from ..plots.map_panels import lying, map_row
from ..plots.maps import (
    default_step,
    drop_panel,
    face_leakage,
    face_size,
    has_maps,
    place_figure,
    row_panel,
)
from ..plots.piece_curves import pieces_of
from ..results.results import Results
from ..results.selections import load_names, loads_as_given
from ..results.tables import leakage_at, leakage_of
from ..topography import Topography
from .error_tables import most_leaking_place

if TYPE_CHECKING:
    import xarray
    from matplotlib.figure import Figure

Array = np.ndarray
#: Pictures that are files of the folder too, by their name without ending; the page alone has the others.
FILES = ("surface", "seal", "seat", "place", "drawn", "pieces", "leakage")
Drawings = Mapping[str, Drawn]


@dataclass(frozen=True)
class Picture:
    """A picture of the page: its data, its alternative text, and its caption."""

    uri: str
    alt: str
    caption: str


def draw_all(results: Results, surface: Topography | None = None) -> dict[str, Drawn]:
    """Draw every picture for which there are data.

    results : of a run.
    surface : the combined heights, for the picture "surface"; None: without.
    """
    # in one process: others would import what draws once more, which takes as long as half of the pictures
    return {name: drawn(draw()) for name, draw in _figures(results, surface).items()}


def _figures(results: Results, surface: Topography | None) -> dict[str, Callable[[], Figure]]:
    """What draws each picture for which there are data."""
    data, s = results.dataset, default_step(results.dataset)
    maps, drawn_seal = has_maps(data), "drawn_corners" in data
    pictures: dict[str, tuple[bool, Callable[[], Figure]]] = {
        "surface": (surface is not None, lambda: heights_figure(cast(Topography, surface))),
        "seal": (maps or drawn_seal, lambda: seal_figure(results)),
        "drawn": (maps and drawn_seal, lambda: drawn_figure(data, s)),
        "pieces": ("piece_k1" in data or "state_k1" in data, lambda: pieces_figure(results)),
        "leakage": (True, lambda: leakage_figure(results)),
        "drop": (maps, lambda: _lines_figure(drop_panel, data)),
        "face": ("face_height" in data, lambda: _face_figure(data)),
        "seat": (
            bool(data.attrs.get("seat")) and "row_pressure" in data,
            lambda: _lines_figure(row_panel, data),
        ),
        "place": ("place_height" in data, lambda: place_figure(data)),
    }
    return {name: draw for name, (there, draw) in pictures.items() if there}


def _lines_figure(panel: Callable[..., None], data: xarray.Dataset) -> Figure:
    sheet = Sheet([4.0])
    panel(sheet.panel(0, LINES), data, drop_steps(data))
    return sheet.figure


def _face_figure(data: xarray.Dataset) -> Figure:
    sheet = Sheet([map_row(lying(face_size(data)), HEIGHTS)])
    height_panel(sheet.panel(0, HEIGHTS), data["face_height"].values * 1e6, face_size(data))
    return sheet.figure


def seat_picture(results: Results, drawings: Drawings) -> Picture:
    """Contact pressure of the rows across the seat."""
    band = results.dataset["band_breadth"].values
    least, most = (to_text(float(f(band)), "m", 3) for f in (np.nanmin, np.nanmax))
    alt = f"Mean contact pressure of rows against x1: the seat touches on a band {least} to {most} broad."
    return Picture(
        _uri(drawings["seat"].whole), alt, "Contact pressure across the seat, mean of each row."
    )


def face_picture(results: Results, drawings: Drawings) -> Picture:
    """Map of the heights that were solved."""
    heights = results.dataset["face_height"].values * 1e6
    sides = " × ".join(to_text(side / 1e3, "m", 3) for side in face_size(results.dataset))
    span = f"{np.nanmin(heights):.3g} to {np.nanmax(heights):.3g} µm"
    alt = f"Map of the heights of the face that was solved, {sides}, {span}."
    return Picture(
        _uri(drawings["face"].whole),
        alt,
        "The face that was solved: heights of the combined faces.",
    )


def place_picture(results: Results, drawings: Drawings) -> Picture:
    """Maps of the measured place that leaks most."""
    sentence = most_leaking_place(results).capitalize()
    maps = (
        "heights, and gap with the contact in grey" if "place_gap" in results.dataset else "heights"
    )
    return Picture(
        _uri(drawings["place"].whole),
        f"Map of the place: {maps}. {sentence}.",
        f"{sentence}: its {maps}.",
    )


def leakage_picture(results: Results, drawings: Drawings) -> Picture:
    """Leakage over load with its band."""
    data, steps = results.dataset, results.steps
    unit, factor = results.leak_scale
    names = load_names(data)
    places = dict.fromkeys((0, results.peak, len(steps) - 1))
    texts = [f"{leakage_at(results, s, factor)} at {names[s]}" for s in places]
    what = leakage_of(results).capitalize()
    alt = f"{what} in {unit.name} against load: {', '.join(texts)}. See the table for all."
    caption = "Leakage against load, one line and marker for each branch of the load cycle."
    if results.budget is not None:
        caption += " Shaded: the band that holds the truth in about 95 of 100 cases."
    elif "leakage_lower" in data:
        caption += " Shaded: redraws of the measured patch."
    return Picture(_uri(drawings["leakage"].whole), alt, caption)


def piece_pictures(results: Results, drawings: Drawings) -> list[Picture]:
    """Permeability of pieces against mean gap, and against pressure."""
    pieces = pieces_of(results)
    top = int(np.argmax(np.where(pieces.loading, pieces.nominal, -np.inf)))
    shut, load = (
        np.nanmean(pieces.k[top] == 0),
        loads_as_given(results.dataset)(float(pieces.nominal[top])),
    )
    many = f"{counted(pieces.k.shape[1], 'piece')} of the face in {counted(len(pieces.k), 'state')}"
    closed = f"At {load} {shut:.0%} of them are closed."
    if shut > 0.5 and results.leakage.values[results.peak] != 0:
        closed += (
            " The face leaks all the same: a piece is closed where nothing passes between its own sides, and grooves "
            "that wind lead the fluid past it through its neighbours."
        )
    texts = [
        (
            f"Permeability of {many} against their mean gap, on loading and unloading, and that of parallel plates.",
            f"Permeability of {many} against mean gap: wide gaps follow h̄³/12 of parallel plates, single channels pass "
            f"more, and narrow gaps close. {closed}",
        ),
        (
            f"Permeability of {many} against their contact pressure: loading in circles, unloading in squares.",
            "Permeability against contact pressure: unloading (squares) lies below loading (circles) because of the "
            "plastic deformation that the peak left.",
        ),
    ]
    return _panels(drawings["pieces"], texts)


def map_pictures(results: Results, drawings: Drawings) -> tuple[str, list[Picture]]:
    """Name of the step of the maps, and maps of the face there."""
    data = results.dataset
    s = default_step(data)
    return load_names(data)[s], _panels(drawings["seal"], _face_texts(data, s))


def _face_texts(data: xarray.Dataset, s: int) -> list[tuple[str, str]]:
    """Alternative texts and captions of the maps of the face."""
    blocks = " × ".join(str(data.sizes[f"block{n}"]) for n in (1, 2))
    names = (
        ("contact_pressure", "Pa", "mean of each block of pixels"),
        ("gap", "m", "mean of each block of pixels"),
        ("fluid_pressure", "Pa", "from the inlet at x1 = 0; mean of the fluid of each block"),
    )
    texts = []
    for name, unit, what in names:
        words, values = name.replace("_", " "), data[f"face_{name}"].values[s]
        alt = f"Map of the {words} of {blocks} blocks of the face, {_range(values, unit)}."
        texts.append((alt, f"{words.capitalize()}, {what}."))
    return texts


def drawn_picture(results: Results, drawings: Drawings) -> Picture:
    """Maps of the drawn seal nearest to the median."""
    data = results.dataset
    s = default_step(data)
    fluid, step = data["drawn_fluid_pressure"].values[s], load_names(data)[s]
    part = part_text(DrawnSeal(data, s))
    alt = f"Maps of {data.sizes['part']} parts of a drawn seal at {step}: fluid pressure, {_range(fluid, 'Pa')}."
    caption = f"The drawn seal nearest to the median, in its plane, at {step}: {part}. Long arrows: much flow."
    return Picture(_uri(drawings["drawn" if "drawn" in drawings else "seal"].whole), alt, caption)


def drop_picture(results: Results, drawings: Drawings) -> Picture:
    """Fluid pressure along the leakage at the first load, half way, and at the highest that leaks."""
    data = results.dataset
    names = [load_names(data)[s] for s in drop_steps(data)]
    alt = f"Mean fluid pressure from inlet to outlet at {', '.join(names)}."
    caption = "Fluid pressure along the leakage, mean over the length of the seal; where it is steep the seal holds."
    return Picture(_uri(drawings["drop"].whole), alt, caption)


def drop_steps(data: xarray.Dataset) -> list[int]:
    """Loading steps that leak: the first, the middle one, and that of the maps last."""
    last = default_step(data)
    loading = np.flatnonzero(np.isnan(data["unloaded_from"].values))
    leaking = loading[np.nan_to_num(face_leakage(data)[loading]) != 0]
    return list(
        dict.fromkeys([*(int(leaking[n]) for n in (0, leaking.size // 2) if leaking.size), last])
    )


def _panels(drawing: Drawn, texts: list[tuple[str, str]]) -> list[Picture]:
    """The first panels of a drawing, with their alternative texts and captions."""
    return [
        Picture(_uri(panel), alt, caption)
        for panel, (alt, caption) in zip(drawing.panels, texts, strict=False)
    ]


def _uri(png: bytes) -> str:
    """A picture as a data URI."""
    return "data:image/png;base64," + base64.b64encode(png).decode()


def _range(values: np.ndarray, unit: str) -> str:
    finite = values[np.isfinite(values)]
    if finite.size == 0:
        return "unknown"
    return f"{to_text(float(finite.min()), unit, 3)} to {to_text(float(finite.max()), unit, 3)}"
