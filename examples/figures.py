"""Draw the figures of Pérez-Ràfols et al. (2018) from a results folder.

    python examples/figures.py RESULTS OUT [CASE]

0 face           the surface, the flow through it at the highest load, and the leakage over the load cycle
1 two_scales     fluid pressure, contact pressure, and three cells in detail
2 cycles         permeability of single cells on loading and unloading, and its scatter over all cells
3 permeability   permeability against mean gap, with the asymptote h̄³/12, and against pressure
4 leakage        leakage of seals of several lengths, and of a seal that is unloaded from four loads
5 constrictions  fraction of the pressure drop in the narrowest cells

Figure 0 can be drawn from any results folder. Figures 1 and 5 need a two-scale run. Figures 2 and 3 need a two-scale or
a stochastic run. For a stochastic run, they show the cells from which the tiles take their permeability. Figure 4 needs
the case of the run as a third argument. Every picture is written as .pdf and .png, 183 mm wide.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.colors import LightSource, ListedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from matplotlib.patheffects import withStroke
from matplotlib.ticker import LogLocator, NullFormatter

import femseal as fs
from femseal.plots.leakage_curves import leakage_curves
from femseal.plots.leakage_panels import leakage_panel

WIDTH = 7.2  # 183 mm, two columns of a journal
CLOSED, RED = "#B0B0B0", "#D7191C"
#: Colours that differ in grey as well, line styles and hatching.
BRANCHES = (("loading", "#E69F00", "-", None), ("unloading", "#00467F", "--", "////"))
PRINT = {"font.size": 8, "axes.titlesize": 8, "legend.fontsize": 7, "lines.linewidth": 1.2, "axes.grid": False,
         "axes.linewidth": 0.6, "legend.frameon": False, "grid.alpha": 0.3,
         "grid.linewidth": 0.4, "savefig.dpi": 300, "pdf.fonttype": 42}  # fmt: skip
#: Colour, line and marker of cells, lengths and peaks.
LINES = (("#D55E00", "-", "o"), ("#0072B2", "--", "s"), ("#009E73", "-.", "^"), ("#CC79A7", ":", "D"),
         ("#56B4E9", (0, (5, 1, 1, 1, 1, 1)), "v"))  # fmt: skip
#: Figure 5: numbers of the narrowest cells, and their colours.
NARROWEST = 1, 3, 10
SHADES = ("#00467F", "#009E73", "#E69F00")
#: Figure 4: peaks and unloading steps, both as fractions of the highest load.
PEAKS, STOPS = (0.25, 0.5, 0.75, 1.0), (0.875, 0.75, 0.625, 0.5, 0.375, 0.25, 0.125, 0.05)
#: Figure 4: lengths of the seals, divided by the length of the surface.
LENGTHS = (0.25, 1, 4, 16)
QUANTILES, BAND = (0.05, 0.95), "5–95 %"
#: Figure 4: realisations for each length, unless the case gives them; as many as the quantiles need.
SEALS = 20


def _sheet(height):
    return Figure(figsize=(WIDTH, height), layout="constrained")


def face_and_leakage(results: fs.Results) -> Figure:
    """Draw figure 0: the surface, the flow through it at the highest load that leaks, and the leakage over the cycle.

    The flow is drawn if the run has stored the gap on all pixels. Otherwise, the heights fill the whole upper row.
    """
    step = _highest_leaking_step(results)
    has_flow = step in results.stored_steps
    sides = sorted(results.dataset["face_height"].shape)
    map_width = (0.4 if has_flow else 0.85) * WIDTH
    heights = map_width * sides[0] / sides[1] + 1.1, 3.7
    figure = Figure(figsize=(WIDTH, sum(heights)), layout="constrained")
    maps, curves = figure.subfigures(2, 1, height_ratios=heights, hspace=0.06)
    if has_flow:
        left, right = maps.subplots(1, 2)
        _draw_flow(right, results, step)
    else:
        left = maps.subplots()
    _draw_relief(left, results)
    axes = curves.subplots()
    leakage = leakage_curves(results)
    handles = leakage_panel(axes, leakage)
    axes.legend(
        handles=handles,
        title=leakage.title,
        handlelength=2.8,
        frameon=True,
        framealpha=0.9,
        edgecolor="none",
    )
    return figure


def _highest_leaking_step(results):
    leaking = np.flatnonzero(np.nan_to_num(results.leakage.values) > 0)
    if leaking.size == 0:
        return None
    return int(leaking[results.dataset["nominal_pressure"].values[leaking].argmax()])


def _draw_map(axes, values, size, **options):
    """Draw a map (n1, n2) of a surface of the given size [mm], with its longer side to the right."""
    x2_is_longer = size[1] > size[0]
    shown = values if x2_is_longer else values.swapaxes(0, 1)
    extent = (0, size[1], 0, size[0]) if x2_is_longer else (0, size[0], 0, size[1])
    labels = ["$x_1$, inlet at 0 [mm]", "$x_2$ along the seal [mm]"]
    axes.set(
        **dict(
            zip(("ylabel", "xlabel") if x2_is_longer else ("xlabel", "ylabel"), labels, strict=True)
        )
    )
    return axes.imshow(shown, origin="lower", extent=extent, **options)


def _draw_relief(axes, results):
    """Draw the heights in colours, lit from the side."""
    heights = results.dataset["face_height"]
    spacing = [float(heights[axis][1] - heights[axis][0]) for axis in heights.dims]
    size = [1e3 * float(heights[axis][0] + heights[axis][-1]) for axis in heights.dims]
    values = 1e6 * heights.values
    colours = matplotlib.colormaps["viridis"]
    image = _draw_map(axes, values, size, cmap=colours)  # for the colour bar
    light = LightSource(azdeg=315, altdeg=50)
    dx, dy = spacing[1] * 1e6, spacing[0] * 1e6
    lit = light.shade(values, colours, blend_mode="soft", vert_exag=3, dx=dx, dy=dy)
    _draw_map(axes, lit, size)
    axes.figure.colorbar(image, ax=axes, label="height [µm]", location="top", aspect=30)


def _draw_flow(axes, results, step):
    """Draw the contact in grey, the fluid pressure in colours, and the flow in red."""
    gap = results.gap(step)
    spacing = tuple(float(gap[axis][1] - gap[axis][0]) for axis in gap.dims)
    size = [1e3 * float(gap[axis][0] + gap[axis][-1]) for axis in gap.dims]
    h = gap.values.astype(float)
    flow = pixel_flow(h, spacing, sides="periodic")["flow"]
    pressure = np.where(h > 0, results.fluid_pressure(step).values / 1e6, np.nan)
    image = _draw_map(axes, pressure, size, cmap="cividis")
    _draw_map(axes, np.ones_like(h), size, alpha=_longer_side_right(np.sqrt(flow), size), vmin=0, vmax=1,
              cmap=ListedColormap([RED]))  # fmt: skip
    axes.set_facecolor(CLOSED)
    label = f"fluid pressure [MPa], {results.dataset['name'].values[step]}"
    axes.figure.colorbar(image, ax=axes, label=label, location="top", aspect=30)


def _longer_side_right(values, size):
    return values if size[1] > size[0] else values.T


def two_scales(results: fs.Results, step: int | None = None) -> Figure:
    """Draw figure 1 of a two-scale run, by default at the highest load at which the seal leaks."""
    data = _with(results, "cell_k1", "a two-scale run")
    leaking = np.flatnonzero(np.nan_to_num(data["leakage_two_scale"].values))
    highest = data["nominal_pressure"].values[leaking]
    s = int(leaking[highest.argmax()]) if step is None else step
    cells = closely(results, s)
    x1, x2 = (2e3 * float(data[name].mean()) for name in ("cell1", "cell2"))
    w1, w2 = x1 / data.sizes["cell1"], x2 / data.sizes["cell2"]
    heights = min(0.42 * WIDTH * x2 / x1, 0.6 * WIDTH) + 0.8, 1.75 * len(cells) + 1.0
    figure = _sheet(sum(heights))
    above, below = figure.subfigures(2, 1, height_ratios=heights)
    flow, contact = above.subplots(1, 2)
    fluid = data["face_fluid_pressure"].values[s] / 1e6
    image = flow.imshow(fluid.T, origin="lower", extent=(0, x1, 0, x2), cmap="cividis")
    above.colorbar(image, ax=flow, shrink=0.8)
    flow.set(facecolor=CLOSED, title="fluid pressure [MPa]", ylabel="$x_2$ along the seal [mm]")
    pressure = data["cell_pressure"].values[s] / 1e6
    image = contact.imshow(pressure.T, origin="lower", extent=(0, x1, 0, x2), cmap="viridis")
    above.colorbar(image, ax=contact, shrink=0.8)
    contact.set(title="contact pressure of cells [MPa]")
    for axes in (flow, contact):
        axes.set(aspect="equal", xlabel="$x_1$ [mm], inlet at 0", xlim=(0, x1), ylim=(0, x2))
        for letter, (i, j) in zip("ABC", cells, strict=False):
            for width, colour in ((2.4, "black"), (1.2, "white")):
                axes.add_patch(Rectangle((i * w1, j * w2), w1, w2, fill=False, ec=colour, lw=width))
            # beside the cell, on the side of the middle
            right = i < data.sizes["cell1"] / 2
            axes.annotate(letter, ((i + right) * w1, (j + 0.5) * w2), (2 if right else -2, 0), weight="bold",
                          textcoords="offset points", ha="left" if right else "right", va="center",
                          color="white", path_effects=[withStroke(linewidth=2, foreground="black")])  # fmt: skip
    _draw_closely(below, cells, (0, w1 * 1e3, 0, w2 * 1e3))
    above.suptitle(str(data["name"].values[s]), fontsize=9)
    return figure


def closely(results: fs.Results, step: int) -> dict[tuple[int, int], dict[str, np.ndarray]]:
    """Return the fields of three cells, with the largest, the median and the smallest k1.

    The fields are the gap [µm], the contact pressure [MPa], the fluid pressure for a unit drop, and the flow between
    pixels divided by its largest value.
    """
    cells, k = {}, results.dataset["cell_k1"].values[step]
    is_open = np.argwhere(k > 0)
    order = is_open[np.argsort(k[k > 0])]
    for place in dict.fromkeys(tuple(map(int, order[n])) for n in (-1, len(order) // 2, 0)):
        gap, contact = results.gap(step, place), results.contact_pressure(step, place)
        spacing = tuple(float(gap[axis][1] - gap[axis][0]) for axis in gap.dims)
        h = gap.values.astype(float)
        cells[place] = pixel_flow(h, spacing) | {"gap": h * 1e6, "contact": contact.values / 1e6}
    return cells


def pixel_flow(
    gap: np.ndarray, spacing: tuple[float, float], sides: str = "mirror"
) -> dict[str, np.ndarray]:
    """Compute the fluid pressure for a unit pressure drop through the gap of a cell [m], and the flow at the pixels."""
    p = fs.cell_permeability(gap, spacing, sides=sides).fluid_pressure
    k, known = gap**3, np.nan_to_num(p)
    # the inlet (pressure 1) and the outlet (pressure 0) are half a pixel beyond the ends
    ends = 2 * k[[0, -1]] * np.abs(known[[0, -1]] - [[1.0], [0.0]])
    q1 = np.vstack([ends[:1], -_between(k) * np.diff(known, axis=0), ends[1:]]) / spacing[0]
    q2 = np.pad(_between(k.T).T * np.diff(known, axis=1), ((0, 0), (1, 1))) / spacing[1]
    q = np.hypot(q1[:-1] + q1[1:], q2[:, :-1] + q2[:, 1:])
    return {"fluid": p, "flow": q / (q.max() or 1.0)}


def _between(k):
    """Return the harmonic means of neighbouring rows; a mean is 0 if one of the two values is 0."""
    total = k[:-1] + k[1:]
    return np.divide(2 * k[:-1] * k[1:], total, out=np.zeros_like(total), where=total > 0)


def _draw_closely(figure, cells, extent):
    panels = figure.subplots(len(cells), 3, sharex=True, sharey=True, squeeze=False)
    titles = {
        "gap": "gap [µm]",
        "contact": "contact pressure [MPa]",
        "fluid": "fluid pressure, flow in red",
    }
    for (name, title), colours, column in zip(
        titles.items(), ("magma", "viridis", "cividis"), panels.T, strict=True
    ):
        top = 1.0 if name == "fluid" else max(cell[name].max() for cell in cells.values())
        for letter, cell, axes in zip("ABC", cells.values(), column, strict=False):
            shown = cell[name] if name == "fluid" else np.where(cell[name] > 0, cell[name], np.nan)
            image = axes.imshow(
                shown.T, origin="lower", extent=extent, cmap=colours, vmin=0, vmax=top
            )
            axes.set_facecolor("white" if name == "contact" else CLOSED)
            if name == "fluid":
                axes.imshow(np.ones_like(shown.T), alpha=np.sqrt(cell["flow"].T), origin="lower", extent=extent,
                            vmin=0, vmax=1, cmap=ListedColormap([RED]))  # fmt: skip
            if name == "gap":
                axes.set_ylabel(f"{letter}: $x_2$ [µm]")
        column[0].set_title(title)
        column[-1].set_xlabel("$x_1$ [µm]")
        figure.colorbar(image, ax=column, location="bottom", shrink=0.8)


def cells_of(results: fs.Results) -> tuple[str, np.ndarray, np.ndarray, np.ndarray]:
    """Return the prefix of the step variables, and pressure, permeability and mean gap of the cells (cells, steps)."""
    kind = "state" if "state_k1" in results.dataset else "cell"
    data = _with(results, f"{kind}_k1", "a two-scale or a stochastic run")
    fields = [data[f"{kind}_{name}"].values for name in ("pressure", "k1", "mean_gap")]
    return "state_" if kind == "state" else "", *(
        field.reshape(len(field), -1).T for field in fields
    )


def up_and_down(results: fs.Results, prefix: str) -> list[np.ndarray]:
    """Return the steps of the loading, and the steps of the unloading from the highest peak."""
    pressure, peaks = (
        results.dataset[f"{prefix}{n}"].values for n in ("nominal_pressure", "unloaded_from")
    )
    up = np.flatnonzero(np.isnan(peaks))
    if up.size == peaks.size:
        raise fs.InputError("results", "loading alone", "a run with unloading")
    peak = np.nanmax(peaks)
    return [up, np.r_[up[pressure[up] == peak], np.flatnonzero(peaks == peak)]]


def _with(results, name, allowed):
    if name not in results.dataset:
        raise fs.InputError("results", f"those of the study {results.method}", allowed)
    return results.dataset


def cycles(results: fs.Results, count: int = 4) -> Figure:
    """Draw figure 2: `count` cells on loading and on unloading from the highest peak, and quantiles of all cells."""
    prefix, _, k, _ = cells_of(results)
    nominal = results.dataset[f"{prefix}nominal_pressure"].values / 1e6
    up, down = up_and_down(results, prefix)
    figure = _sheet(3.4)
    grid = figure.add_gridspec(2, 2, height_ratios=(3.2, 1))
    single, every = figure.add_subplot(grid[:, 0]), figure.add_subplot(grid[0, 1])
    closed = figure.add_subplot(grid[1, 1], sharex=every)
    for cell, (colour, line, _) in zip(typical(k, up, down, count), LINES[1:], strict=False):
        for steps, width, size in ((up, 0.8, 1.8), (down, 2.0, 3.0)):
            label = f"cell {cell}" if steps is down else None
            single.plot(nominal[steps], _open(k[cell, steps]), color=colour, ls=line, lw=width, marker="o", ms=size,
                        label=label)  # fmt: skip
    single.set_title("(a) thin: loading, thick: unloading; no line: closed")
    single.set(
        yscale="log",
        xlabel="nominal pressure [MPa]",
        ylabel="permeability $k_1$ [m³]",
        xlim=(0, None),
    )
    single.legend(handlelength=4, loc="best")
    floor = _floor(k)
    for steps, (name, colour, line, hatch) in zip((up, down), BRANCHES, strict=True):
        low, middle, high = (
            np.nanquantile(k[:, steps], q, axis=0) for q in (QUANTILES[0], 0.5, QUANTILES[1])
        )
        every.fill_between(nominal[steps], np.maximum(low, floor), np.maximum(high, floor), facecolor=colour, alpha=0.3,
                           hatch=hatch, edgecolor=colour, lw=0)  # fmt: skip
        every.plot(nominal[steps], _open(middle), color=colour, ls=line, lw=1.8, label=name)
        closed.plot(
            nominal[steps], 100 * np.mean(k[:, steps] == 0, axis=0), color=colour, ls=line, lw=1.8
        )
    every.set(yscale="log", ylabel="$k_1$ [m³]", ylim=(floor, None))
    every.set_title(f"(b) median and {BAND} of {len(k)} cells")
    every.legend(loc="lower left", frameon=True, framealpha=0.9)
    every.tick_params(labelbottom=False)
    closed.set(xlabel="nominal pressure [MPa]", ylabel="closed [%]", xlim=(0, None), ylim=(0, None))
    return figure


def typical(k: np.ndarray, up: np.ndarray, down: np.ndarray, count: int) -> np.ndarray:
    """Choose cells at even spacing, sorted by the number of steps at which they are open, then by k at the peak.

    Cells that are never open are left out.
    """
    path = k[:, np.r_[up, down[1:]]]
    order = np.lexsort((k[:, up[-1]], (path > 0).sum(axis=1)))
    order = order[(path[order] > 0).any(axis=1) & np.isfinite(path[order]).all(axis=1)]
    return order[np.unique(np.round(np.linspace(0.1, 0.95, count) * (order.size - 1)).astype(int))]


def permeability(results: fs.Results) -> Figure:
    """Draw figure 3: k of cells on loading and on unloading from the highest peak, against gap and pressure."""
    prefix, pressure, k, gap = cells_of(results)
    nominal = results.dataset[f"{prefix}nominal_pressure"].values / 1e6
    figure = _sheet(3.2)
    left, right = figure.subplots(1, 2, sharey=True)
    for steps, (name, colour, line, _), marker in zip(
        up_and_down(results, prefix), BRANCHES, "ox", strict=True
    ):
        shown = k[:, steps] > 0
        for axes, x in ((left, gap * 1e6), (right, pressure / 1e6)):
            axes.plot(x[:, steps][shown], k[:, steps][shown], color=colour, marker=marker, ms=2.3, mew=0.6, ls="",
                      mfc="none", alpha=0.7, label=name, rasterized=True)  # fmt: skip
        right.plot(nominal[steps], _open(np.nanmedian(k[:, steps], axis=0)), color=colour, ls=line, lw=2.2, zorder=3,
                   label=f"{name}, median", path_effects=[withStroke(linewidth=4, foreground="white")])  # fmt: skip
    h = gap[(k > 0) & (gap > 0)] * 1e6
    plates = np.geomspace(h.min(), h.max(), 50)
    left.plot(plates, (plates * 1e-6) ** 3 / 12, color="black", lw=1.6, label=r"$\bar h^3/12$")
    left.set(
        xscale="log",
        yscale="log",
        xlabel=r"mean gap $\bar h$ of the cell [µm]",
        ylabel="permeability $k_1$ [m³]",
    )
    if plates[-1] < 100 * plates[0]:
        left.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        left.xaxis.set_major_formatter("{x:g}")
        left.xaxis.set_minor_formatter(NullFormatter())
    left.set_ylim(_floor(k), 3 * max(np.nanmax(k), (plates[-1] * 1e-6) ** 3 / 12))
    right.set(xlabel="pressure of the cell [MPa]", xlim=(0, None))
    left.legend(loc="lower right", markerscale=2)
    right.legend(loc="upper right", markerscale=2)
    return figure


def _floor(k):
    """Return the lower limit of an axis: below the smallest value, but at most twelve decades below the largest."""
    return max(k[k > 0].min() / 3, 1e-12 * np.nanmax(k))


def drawn_seals(case: fs.Case, lengths=LENGTHS) -> list:
    """Simulate seals of several lengths (multiples of the surface length), each unloaded from four loads."""
    prepared, count = fs.preparation.prepare(case), case.stochastic.realisations or SEALS
    scene, top = prepared.scene, prepared.scene.loading[-1]
    peaks = tuple(part * top for part in PEAKS)
    stops = tuple(part * top for part in STOPS)
    scene = replace(
        scene, loading=tuple(sorted({*scene.loading, *peaks})), unload_from=peaks, unloading=stops
    )
    seals = []
    for n in lengths:
        sampling = fs.Sampling(
            n * scene.surface.size[1], count, seed=case.seed, median_fields=False
        )
        seals.append(fs.stochastic(scene, prepared.cells, sampling))
    return seals


def leakage(seals: list) -> Figure:
    """Draw figure 4: median leakage of all seals unloaded from the highest peak, and of the longest from all peaks."""
    figure = _sheet(3.4)
    left, right = figure.subplots(1, 2, sharey=True)
    steps = seals[0].steps
    pressure = np.array([s.pressure for s in steps]) / 1e6
    peaks = sorted({s.unloaded_from for s in steps if s.unloaded_from is not None})
    floor = _floor(np.array([seal.quantile(0.5) for seal in seals]))
    shades = matplotlib.colormaps["viridis"](np.linspace(0.85, 0, len(seals)))
    for seal, colour, (_, line, marker) in zip(seals, shades, LINES, strict=False):
        label = f"{seal.seal.length * 1e3:.3g} mm"
        for at, width, text in zip(_path(steps, peaks[-1]), (0.8, 1.8), (None, label), strict=True):
            low, middle, high = (seal.quantile(q)[at] for q in (QUANTILES[0], 0.5, QUANTILES[1]))
            middle = _open(middle)
            left.plot(
                pressure[at],
                middle,
                color=colour,
                ls=line,
                lw=width,
                marker=marker,
                ms=3,
                markevery=3,
                label=text,
            )
            left.fill_between(
                pressure[at],
                np.maximum(low, floor),
                np.maximum(high, floor),
                color=colour,
                alpha=0.2,
                lw=0,
            )
    left.set_title(f"(a) median and {BAND}; thin: loading, thick: unloading")
    left.legend(title="length (no line: sealed)", handlelength=4)
    median = _open(seals[-1].quantile(0.5))
    at = _path(steps, peaks[-1])[0]
    right.plot(pressure[at], median[at], color=BRANCHES[0][1], lw=2.2, label="loading")
    for peak, (_, line, marker), grey in zip(
        peaks, LINES[1:], np.linspace(0.55, 0, len(peaks)), strict=False
    ):
        at = _path(steps, peak)[1]
        right.plot(pressure[at], median[at], color=str(grey), ls=line, marker=marker, ms=3.2, markevery=3,
                   label=f"from {peak / 1e6:.4g} MPa")  # fmt: skip
    right.set_title(f"(b) {seals[-1].seal.length * 1e3:.3g} mm, unloaded from several loads")
    right.legend(handlelength=4)
    left.set(yscale="log", ylabel="leakage per length of seal [m²/s]", ylim=(floor, None))
    for axes in (left, right):
        axes.set(xlabel="nominal pressure [MPa]", xlim=(0, None))
    return figure


def _path(steps, peak):
    """Return the steps of the loading up to a peak, and the steps of the unloading from this peak."""
    up = [n for n, s in enumerate(steps) if s.unloaded_from is None and s.pressure <= peak]
    return up, [up[-1], *(n for n, s in enumerate(steps) if s.unloaded_from == peak)]


def _open(values):
    """Replace values that are not positive by NaN, so that no line is drawn there."""
    return np.where(values > 0, values, np.nan)


def constrictions(results: fs.Results) -> Figure:
    """Draw figure 5: the pressure drop in the narrowest cells against the leakage, and a map at the lowest leakage."""
    data = _with(results, "cell_drop_fraction", "a two-scale run")
    q, fractions = data["leakage_two_scale"].values, data["cell_drop_fraction"].values
    leaking = np.flatnonzero(np.nan_to_num(q) != 0)
    if leaking.size == 0:
        raise fs.InputError("results", "a seal that never leaks", "a seal that leaks at some load")
    least = int(leaking[np.argmin(np.abs(q[leaking]))])
    figure = _sheet(3.1)
    left, right = figure.subplots(1, 2)
    loading = np.isnan(data["unloaded_from"].values)
    falling = np.sort(fractions.reshape(len(q), -1), axis=1)[:, ::-1].cumsum(axis=1)
    for count, colour, marker in zip(NARROWEST, SHADES, "os^", strict=True):
        parts, style = (
            falling[:, min(count, falling.shape[1]) - 1],
            {"color": colour, "marker": marker, "mew": 0.8},
        )
        name = f"the narrowest {count}" if count > 1 else "the narrowest"
        left.plot(np.abs(q / q[0])[loading], parts[loading], ms=4, label=name, **style)
        left.plot(np.abs(q / q[0])[~loading], parts[~loading], ls="", ms=2, **style)
    left.set(
        xscale="log",
        xlabel="leakage / leakage at the first load",
        ylabel="fraction of the pressure drop",
        ylim=(0, 1.03),
    )
    left.invert_xaxis()
    left.set_title("(a) large: loading, small: unloading")
    left.legend()
    sides = [2e3 * data[name].values.mean() for name in ("cell1", "cell2")]
    image = right.imshow(
        100 * fractions[least].T, origin="lower", extent=(0, sides[0], 0, sides[1]), cmap="Blues"
    )
    figure.colorbar(image, ax=right, shrink=0.7, label="pressure drop in a cell [%]")
    right.set(
        xlabel="$x_1$, inlet at 0 [mm]",
        ylabel="$x_2$ [mm]",
        title=f"(b) {data['name'].values[least]}",
    )
    return figure


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("results", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("case", type=Path, nargs="?")
    options = parser.parse_args()
    results = fs.open_results(options.results)
    case = fs.load_case(options.case) if options.case else None
    if case is not None and results.case != case.echo():
        raise fs.InputError("case", f"'{options.case}'", "the case that produced these results")
    options.out.mkdir(parents=True, exist_ok=True)
    drawings = {
        "0_face": lambda: face_and_leakage(results),
        "1_two_scales": lambda: two_scales(results),
        "2_cycles": lambda: cycles(results),
        "3_permeability": lambda: permeability(results),
        "5_constrictions": lambda: constrictions(results),
    }
    if case is not None and case.stochastic is not None:
        drawings["4_leakage"] = lambda: leakage(drawn_seals(case))
    with matplotlib.rc_context(PRINT):
        for name, draw in sorted(drawings.items()):
            try:
                figure = draw()
            except fs.InputError as error:
                print(f"figure {name} is left out: {error}")
                continue
            for suffix in (".pdf", ".png"):
                figure.savefig(options.out / f"figure_{name}{suffix}")
            print(options.out / f"figure_{name}.pdf")


if __name__ == "__main__":
    main()
