"""Pictures of a run: each is drawn once, for the folder and for the page."""

from __future__ import annotations

import base64
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, NamedTuple, cast

import numpy as np

from ..plots import heights_figure, leakage_figure, pieces_figure, seal_figure
from ..plots.drawing import GREY, HEIGHTS, LINES, STYLES, Sheet, decades, lying, map_row, png
from ..plots.drawn_panels import drawn_figure
from ..plots.heights import height_panel
from ..plots.maps import (
    default_step,
    drop_steps,
    face_size,
    has_maps,
    place_figure,
    row_panel,
)
from ..results.results import Results
from ..results.selections import load_names
from ..topography import Topography

if TYPE_CHECKING:
    import xarray
    from matplotlib.figure import Figure

#: Pictures that are files of the folder too, by their name without ending; the page alone has the others.
FILES = ("surface", "seal", "seat", "place", "drawn", "pieces", "leakage")
#: Pictures as PNG by their name.
Drawings = Mapping[str, bytes]


class Picture(NamedTuple):
    """A picture of the page as a data URI, with its caption."""

    uri: str
    caption: str


def page_pictures(results: Results, drawings: Drawings) -> dict[str, Picture]:
    """The pictures of the page by their name."""
    captions = _captions(results)
    return {
        name: Picture(png_uri(drawing), captions[name])
        for name, drawing in drawings.items()
        if name in captions
    }


def _captions(results: Results) -> dict[str, str]:
    """What each picture of the page shows."""
    data = results.dataset
    load = load_names(data)[default_step(data)]
    drawn_seal = f"The drawn seal nearest to the median, in its plane, at {load}."
    maps = (
        f"Contact pressure, gap and fluid pressure of the face at {load}, mean of each block of "
        "pixels, and the fluid pressure along the leakage from the inlet at x1 = 0."
    )
    place = most_leaking_place(results).capitalize() if "place_height" in data else ""
    return {
        "face": "The face that was solved: heights of the combined faces.",
        "seat": "Contact pressure across the seat, mean of each row.",
        "place": f"{place}: its heights, and its gap with the contact in grey.",
        "leakage": "Leakage against load, a line for each branch of the load cycle.",
        "seal": maps if has_maps(data) else drawn_seal,
        "drawn": drawn_seal,
        "attempts": "Error of each attempt against its time; the line is the accuracy asked for.",
        "pieces": "Permeability of pieces against mean gap: wide gaps follow h̄³/12 of parallel "
        "plates, and narrow gaps close. A piece is closed where nothing passes between its own "
        "sides; grooves that wind may lead the fluid past it. Below, against contact pressure: "
        "unloading (squares) lies below loading (circles) because of the plastic deformation that "
        "the peak left.",
    }


def draw_all(results: Results, surface: Topography | None = None) -> dict[str, bytes]:
    """Draw every picture for which there are data.

    results : of a run.
    surface : the combined heights, for the picture "surface"; None: without.
    """
    # in one process: others would import what draws once more, which takes as long as half of the pictures
    return {name: png(draw()) for name, draw in _figures(results, surface).items()}


def _figures(results: Results, surface: Topography | None) -> dict[str, Callable[[], Figure]]:
    """What draws each picture for which there are data."""
    data, s = results.dataset, default_step(results.dataset)
    maps, drawn_seal = has_maps(data), "drawn_corners" in data
    found = results.attempts or {"attempts": []}
    pictures: dict[str, tuple[bool, Callable[[], Figure]]] = {
        "surface": (surface is not None, lambda: heights_figure(cast(Topography, surface))),
        "seal": (maps or drawn_seal, lambda: seal_figure(results)),
        "drawn": (maps and drawn_seal, lambda: drawn_figure(data, s)),
        "pieces": ("piece_k1" in data or "state_k1" in data, lambda: pieces_figure(results)),
        "leakage": (True, lambda: leakage_figure(results)),
        "face": ("face_height" in data, lambda: _face_figure(data)),
        "seat": (
            bool(data.attrs.get("seat")) and "row_pressure" in data,
            lambda: _seat_figure(data, s),
        ),
        "place": ("place_height" in data, lambda: place_figure(data)),
        "attempts": (
            any(attempt["half_width"] is not None for attempt in found["attempts"]),
            lambda: _attempts_figure(found),
        ),
    }
    return {name: draw for name, (there, draw) in pictures.items() if there}


def _seat_figure(data: xarray.Dataset, s: int) -> Figure:
    sheet = Sheet([4.0])
    row_panel(sheet.panel(0, LINES), data, drop_steps(data, s))
    return sheet.figure


def _attempts_figure(found: dict[str, Any]) -> Figure:
    """Error of the attempts whose error is known against their time, by their numbers."""
    sheet = Sheet([3.2])
    axes = sheet.panel(0, LINES)
    axes.set(xlabel="time of the attempt [s]", ylabel="error [%]", yscale="log")
    axes.grid(alpha=0.25, lw=0.6)
    axes.axhline(100 * found["wanted"], color=GREY, ls="--", lw=1)
    for number, attempt in enumerate(found["attempts"], start=1):
        if attempt["half_width"] is not None:
            at = attempt["with_coarse"], 100 * np.expm1(attempt["half_width"])
            axes.plot(*at, "o", color=STYLES[0]["color"])
            axes.annotate(str(number), at, xytext=(6, 4), textcoords="offset points")
    axes.set_xlim(left=0)
    decades(axes.yaxis)
    return sheet.figure


def _face_figure(data: xarray.Dataset) -> Figure:
    sheet = Sheet([map_row(lying(face_size(data)), HEIGHTS)])
    height_panel(sheet.panel(0, HEIGHTS), data["face_height"].values * 1e6, face_size(data))
    return sheet.figure


def png_uri(picture: bytes) -> str:
    """A picture as a data URI."""
    return "data:image/png;base64," + base64.b64encode(picture).decode()


def most_leaking_place(results: Results) -> str:
    """Which of several measured places leaks most by itself, and how much, over the loads that count."""
    about = results.dataset["place_height"].attrs
    count = results.dataset.sizes["place"]
    if not about["over_mean"]:
        return f"place {about['place']} of {count}, of which none leaks"
    return (
        f"place {about['place']} of {count} leaks most, {about['over_mean']:.3g} times their mean"
    )
