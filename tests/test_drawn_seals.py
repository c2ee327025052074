"""What a drawn seal looks like: flux and contact pressure over its parts, in results, pictures and files."""

from dataclasses import replace

import meshio
import numpy as np
import pytest
import pyvista
from femseal.library import ColumnRuns, LinkTable, draw_links, draw_pressures
from femseal.seal.element_windows import ElementSeal, ElementWindows
from femseal.seal.laid_windows import LinkWindows
from numpy.testing import assert_allclose, assert_array_equal
from skfem import MeshQuad, MeshTri
from small_cases import STRIP
from vtkmodules.vtkIOHDF import vtkHDFReader

import femseal as fs
from femseal.case.case import parse_case
from femseal.loads import LoadProgramme
from femseal.plots import seal_figure
from femseal.results import assemble, open_results, write_vtk
from femseal.seal.pressure_map import Profile

FLUID = fs.Liquid(1e-3)


def _flow(seal, permeability):
    """Leakage, and the potential of the nodes over the density of volume rates."""
    leakage = fs.seal_leakage(seal, permeability, FLUID, inlet_pressure=2e6, outlet_pressure=1e6)
    return leakage, FLUID.potential(leakage.fluid_pressure) / FLUID.reference_density


@pytest.mark.parametrize("kind", ["strip", "ring", "inwards"])
def test_flux_through_links_carries_the_leakage_through_every_row(kind):
    rng = np.random.default_rng(1)
    n1, n2 = 5, 24
    if kind == "strip":
        seal, widths = fs.RectangularSeal((2e-3, 12e-3), (n1, n2)), np.full((n1, 1), 12e-3 / n2)
    else:
        seal = fs.AnnularSeal(4e-3, 6e-3, (n1, n2), "inner" if kind == "ring" else "outer")
        # widths where the flux of a link of constant permeability is its difference quotient
        ends = seal.radii
        widths = (np.diff(ends) / np.diff(np.log(ends)))[:, None] * 2 * np.pi / n2
    laid = LinkWindows(seal)
    k = np.exp(rng.normal(size=(n1, n2))) * 1e-18, np.zeros((n1 - 1, n2))
    leakage, potential = _flow(seal, k)
    flux = laid.flux(k, potential, leakage.volume_rate).reshape(n1, n2, 2)
    outwards = np.diff(seal.points, axis=0)
    outwards /= np.linalg.norm(outwards, axis=2, keepdims=True)
    through = ((flux * outwards).sum(axis=2) * widths).sum(axis=1)
    assert_allclose(through, leakage.volume_rate, rtol=1e-9)
    k = k[0], np.exp(rng.normal(size=(n1 - 1, n2))) * 1e-18
    leakage, potential = _flow(seal, k)
    flux = laid.flux(k, potential, leakage.volume_rate).reshape(n1, n2, 2)
    through = ((flux * outwards).sum(axis=2) * widths).sum(axis=1)
    assert_allclose(through, leakage.volume_rate, rtol=0.02)  # links across are no longer straight on a ring
    sideways = flux - (flux * outwards).sum(axis=2)[..., None] * outwards
    assert np.linalg.norm(sideways, axis=2).max() > 0.5 * leakage.volume_rate / (n2 * widths.min())


def test_flux_across_is_the_mean_of_the_links_at_the_corners():
    seal = fs.RectangularSeal((3e-3, 4e-3), (3, 4))
    potential = np.random.default_rng(4).normal(size=(4, 4))
    k = np.ones((3, 4)), np.ones((2, 4))
    flux = LinkWindows(seal).flux(k, potential, 1.0).reshape(3, 4, 2)
    link = -(np.roll(potential, -1, axis=1) - potential)[1:3] / 1e-3  # from column j to j + 1
    assert_allclose(flux[1, 2, 1], (link[0, 1] + link[0, 2] + link[1, 1] + link[1, 2]) / 4)
    assert_allclose(flux[0, 0, 1], (link[0, 3] + link[0, 0]) / 4)  # none at the inlet
    assert_allclose(flux[..., 0], -np.diff(potential, axis=0) / 1e-3)


def test_flux_is_nothing_in_pockets_and_closed_links():
    seal = fs.RectangularSeal((3e-3, 4e-3), (3, 4))
    k1, k2 = np.full((3, 4), 1e-18), np.zeros((2, 4))
    k1[[0, 2], 1] = 0.0  # nodes of a column that neither end reaches
    leakage, potential = _flow(seal, (k1, k2))
    assert np.isnan(potential[1, 1])
    flux = LinkWindows(seal).flux((k1, k2), potential, leakage.volume_rate).reshape(3, 4, 2)
    assert not flux[:, 1].any()
    assert_allclose(flux[:, [0, 2, 3], 0], leakage.per_length * 4 / 3)


@pytest.mark.parametrize("mesh", [MeshQuad, MeshTri])
def test_flux_through_elements_is_that_of_darcy(mesh):
    """A uniform tensor: the flux of the closed strip is along it, whatever the directions of its principal axes."""
    plain = mesh.init_tensor(np.linspace(0, 2e-3, 9), np.linspace(0, 3e-3, 13))
    ends = [plain.facets_satisfying(lambda x, at=at: np.isclose(x[0], at)) for at in (0.0, 2e-3)]
    seal = ElementSeal(plain, *ends, (2e-3, 3e-3), plain.p.T[plain.t.T])
    count = plain.nelements
    laid = ElementWindows(seal, (0.25e-3, 0.25e-3), np.tile([0.0, 1.0], (count, 1)))
    tensor = np.tile(np.diag([3e-18, 1e-18]), (count, 1, 1))
    leakage, potential = _flow(seal, tensor)
    flux = laid.flux(tensor, potential, leakage.volume_rate)
    assert_allclose(flux[:, 0], leakage.per_length, rtol=1e-6)
    assert_allclose(flux[:, 1], 0.0, atol=1e-9 * leakage.per_length)
    assert leakage.per_length == pytest.approx(3e-18 / 1e-3 * 1e6 / 2e-3, rel=1e-6)


def test_flux_through_random_elements_has_the_power_of_the_leakage():
    """∫ q·∇p over the seal is leakage × pressure drop, although linear elements would carry more."""
    plain = MeshTri.init_tensor(np.linspace(0, 2e-3, 17), np.linspace(0, 3e-3, 25))
    ends = [plain.facets_satisfying(lambda x, at=at: np.isclose(x[0], at)) for at in (0.0, 2e-3)]
    corners = plain.p.T[plain.t.T]
    seal = ElementSeal(plain, *ends, (2e-3, 3e-3), corners)
    laid = ElementWindows(seal, (0.1e-3, 0.1e-3), np.tile([0.0, 1.0], (plain.nelements, 1)))
    k = np.exp(1.5 * np.random.default_rng(2).normal(size=plain.nelements)) * 1e-18
    tensor = k[:, None, None] * np.eye(2)
    leakage, potential = _flow(seal, tensor)
    flux = laid.flux(tensor, potential, leakage.volume_rate)
    edges = np.stack([corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]], axis=1)
    at = leakage.fluid_pressure[plain.t.T]
    gradient = np.linalg.solve(edges, (at[:, 1:] - at[:, :1])[..., None])[..., 0]
    area = 0.5 * np.abs(np.linalg.det(edges))
    assert -area @ (flux * gradient).sum(axis=1) == pytest.approx(leakage.volume_rate * 1e6, rel=1e-9)


def test_values_of_windows_are_averaged_over_the_parts():
    plain = MeshQuad.init_tensor(np.linspace(0, 2e-3, 3), np.linspace(0, 2e-3, 3))
    ends = [plain.facets_satisfying(lambda x, at=at: np.isclose(x[0], at)) for at in (0.0, 2e-3)]
    seal = ElementSeal(plain, *ends, (2e-3, 2e-3), plain.p.T[plain.t.T])
    laid = ElementWindows(seal, (0.5e-3, 0.5e-3), np.tile([0.0, 1.0], (4, 1)))
    windows = laid.draws[0][1]
    assert windows == 16
    values = np.arange(16.0)[None]
    assert_allclose(laid.means(values), [1.5, 5.5, 9.5, 13.5])
    links = LinkWindows(fs.RectangularSeal((1.0, 1.0), (2, 3)))
    assert_allclose(links.means(np.arange(6.0).reshape(2, 3)), np.arange(6.0))


# --- contact pressure of the windows ----------------------------------------------------------------------


@pytest.mark.parametrize("sampler", ["history", "block", "copula", "derivative"])
def test_pressures_are_those_of_the_windows_that_are_drawn(sampler):
    steps = LoadProgramme.of([1e8, 3e8])
    pressure = np.random.default_rng(3).uniform(1e7, 5e8, size=(2, 3, 8))
    path = np.repeat(np.arange(3)[:, None], 20, axis=1)
    table = LinkTable(pressure * 1e-27, path, steps, run_length=4.0, pressure=pressure)
    which = {"sampler": sampler, "seed": 5, "realisation": 2, "axis": 0}
    k, p = draw_links(table, **which), draw_pressures(table, **which)
    for s in range(2):
        if sampler in ("history", "block"):
            assert_allclose(p(s), k(s) * 1e27)
        else:  # they draw no windows
            assert_allclose(p(s), pressure[s].mean(axis=1)[path])
    of_paths = LinkTable(pressure, path, steps, run_length=4.0, pressure=pressure[:, :, :1])
    assert_allclose(draw_pressures(of_paths, **which)(1), pressure[1, :, 0][path])
    assert draw_pressures(LinkTable(pressure, path, steps), **which) is None


# --- the seal nearest to the median -----------------------------------------------------------------------

CASE = STRIP | {
    "stochastic": {"length": "240 um", "realisations": 5, "library_cells": 16, "sampler": "block"},
    "output": {"paraview": "both"},
}
RING = {
    "seal": {"kind": "annular", "inner_radius": "0.15 mm", "outer_radius": "0.3 mm"},
    "stochastic": {"pressure": "uniform", "realisations": 5, "library_cells": 4},
}


@pytest.fixture(scope="module")
def strip(tmp_path_factory):
    folder = tmp_path_factory.mktemp("strip") / "out"
    return fs.run(parse_case(CASE), folder, workers=1)


@pytest.fixture(scope="module")
def ring():
    return fs.run(parse_case(CASE | RING), workers=1)


def test_fields_are_those_of_one_realisation(strip):
    data = strip.dataset
    own = data["leakage"].values[data["drawn_corners"].attrs["realisation"]]
    flux = data["drawn_flux"].values.reshape(3, 2, -1, 2)
    assert_allclose(flux[..., 0].mean(axis=2), np.repeat(own[:, None], 2, axis=1), rtol=1e-6)
    assert_allclose(flux[..., 1].sum(axis=(1, 2)), 0.0, atol=5 * flux.max())
    # every window has the pressure that a window of the face has, cut once more half a window further
    pressure = data["drawn_window_pressure"].values
    face = data["library_pressure"].values.T.reshape(3, 2, 4)
    known = np.concatenate([face, (face + np.roll(face, -1, axis=2)) / 2], axis=2)
    for s in range(3):
        for row, drawn in enumerate(pressure[s].reshape(2, -1)):
            assert set(drawn.round(3)) <= set(known[s, row].round(3))
    assert np.corrcoef(pressure[1], data["drawn_permeability"].values[1])[0, 1] < 0


def test_seals_under_a_global_contact_leak_less_under_every_higher_load_and_more_when_relieved():
    """Windows that only began to touch lifted off the body, and relieved ones sank to where the deepest pressed lie."""
    face = STRIP["face"] | {"rms_slope": 0.05}
    steps = ["10 MPa", "30 MPa", "50 MPa", "100 MPa", "200 MPa", "250 MPa", "300 MPa"]
    load = {"loading": ["0 MPa", *steps], "unload_from": ["300 MPa"], "unloading": [*steps[-2::-1], "0 MPa"]}
    for points, cells in (([32, 64], [2, 4]), ([64, 128], [4, 8])):
        drawn = {"length": "600 um", "realisations": 8, "library_cells": 8, "pressure": "global"}
        case = STRIP | {
            "face": face | {"points": points},
            "load": load,
            "cells": {"count": cells},
            "contact": {"boundary": ["mirror", "periodic"], "fluid_pressure": "ignored"},
            "stochastic": drawn,
            "output": {"pictures": False, "budget": False},
        }
        loading, unloading = np.split(fs.run(parse_case(case), workers=1).stochastic.leakage, [8], axis=1)
        assert (loading[:, 1:] < loading[:, :-1]).all()
        assert (unloading[:, 1:] > unloading[:, :-1]).all()


# --- chains of runs ----------------------------------------------------------------------------------------

DEFAULT = {"stochastic": {"length": "480 um", "realisations": 5, "library_cells": 8}}


@pytest.fixture(scope="module")
def chain(tmp_path_factory):
    folder = tmp_path_factory.mktemp("chain") / "out"
    return fs.run(parse_case(CASE | DEFAULT), folder, workers=1)


def test_the_median_chain_of_runs_carries_its_leakage_from_inlet_to_outlet(chain):
    data, seals = chain.dataset, chain.stochastic
    assert seals.sampler == "runs"
    own = data["leakage"].values[data["drawn_corners"].attrs["realisation"]]
    flux = data["drawn_flux"].values.reshape(3, 2, 32, 2)
    assert_allclose(flux[..., 0].mean(axis=2), np.repeat(own[:, None], 2, axis=1), rtol=1e-12)
    fluid = data["drawn_fluid_pressure"].values.reshape(3, 2, 32)
    assert np.nanmin(fluid) >= 0
    assert np.nanmax(fluid) <= 1e6
    assert np.all(np.diff(np.nanmean(fluid, axis=2), axis=1) < 0)
    # every column has permeability and contact pressure of the same column of the face, at every step
    k, p = (data[f"drawn_{name}"].values.reshape(6, 32) for name in ("permeability", "window_pressure"))
    known = [data[f"library_{name}"].values.T.reshape(6, 4) for name in ("k", "pressure")]
    for column in range(32):
        which = np.flatnonzero([np.allclose(p[:, column], known[1][:, j], rtol=1e-6) for j in range(4)])
        assert which.size == 1
        assert_allclose(k[:, column], known[0][:, which[0]], rtol=1e-6)


def test_a_chain_of_one_run_again_and_again_has_the_fields_of_the_face():
    one = fs.self_affine((48, 24), (48e-6, 24e-6), hurst=0.8, rms_slope=0.1, roll_off=16e-6, cut_off=6e-6, rng=1)
    repeated = fs.Topography(np.tile(one.heights, (1, 4)), (1e-6, 1e-6))
    scene = fs.Scene(repeated, 115e9, 3e9, FLUID, 2e6, 1e6, loading=(5e7, 2e8))
    face = fs.two_scale(scene, (2, 4))
    seals = fs.stochastic(scene, (2, 4), fs.Sampling(480e-6, 3, 1, 1), two_scale=face)
    fields, like = seals.median_seal, np.ones(20)
    assert seals.seal.cells == (2, 20)
    assert_allclose(fields.pressure.reshape(2, 2, 20), face.pressure[..., :1] * like, rtol=1e-5)
    flux = fields.flux.reshape(2, 2, 20, 2)
    # the mean over the four sides of a window is nearly that over its fluid
    of_windows = np.nanmean(face.fluid_pressure.astype(float).reshape(2, 2, 24, 96), axis=(2, 3))
    assert_allclose(fields.fluid_pressure.reshape(2, 2, 20), of_windows[..., None] * like, atol=0.1e6)
    for s in range(2):
        through = ColumnRuns.of(face.gap[s], face.partition).window_flux()[:, :1] * 1e6 / FLUID.viscosity
        assert_allclose(flux[s], np.repeat(through, 20, axis=1), rtol=1e-6)
        permeability = ColumnRuns.of(face.gap[s], face.partition).face.conductance * 48 / 96
        assert_allclose(flux[s, ..., 0], permeability * 1e6 / FLUID.viscosity / 48e-6, rtol=1e-6)


def test_a_chain_with_a_failed_step_has_the_fields_of_the_others(chain):
    scene = chain.scene
    face = fs.two_scale(scene, (2, 4))
    gap = face.gap.copy()
    gap[1, :5, :5] = np.nan
    broken = replace(face, fields=replace(face.fields, gap=gap))
    fields = fs.stochastic(scene, (2, 4), fs.Sampling(480e-6, 3, 8, 1), two_scale=broken).median_seal
    assert np.isnan(fields.permeability).all(axis=1).tolist() == [False, True, False]
    assert np.isnan(fields.flux).all(axis=(1, 2)).tolist() == [False, True, False]


def test_chains_are_in_pictures_reports_and_files(chain):
    titles = [axes.get_title().split(" [")[0] for axes in seal_figure(chain, 1).axes if axes.get_title()]
    assert titles == ["fluid pressure", "flux", "contact pressure of windows", "permeability"]
    assert "drawn seal nearest to the median" in (chain.folder / "report.html").read_text(encoding="utf-8")
    mesh = meshio.read(chain.folder / "vtk" / "drawn" / "step_0001.vtu")
    pressure = chain.dataset["drawn_fluid_pressure"].values[1] / 1e6
    assert_allclose(mesh.cell_data["fluid_pressure_MPa"][0], pressure, rtol=1e-6)


def test_a_short_seal_is_drawn_once_as_a_whole():
    short = {"length": "60 um", "realisations": 3, "library_cells": 8, "sampler": "block"}
    figure = seal_figure(fs.run(parse_case(CASE | {"stochastic": short}), workers=1), 1)
    assert figure.get_suptitle().endswith("\nthe whole seal")
    titles = [axes.get_title().split(" [")[0] for axes in figure.axes if axes.get_title()]
    assert titles == ["fluid pressure", "flux", "contact pressure of windows", "permeability"]


def test_fields_of_a_ring_flow_outwards(ring):
    data = ring.dataset
    centres = data["drawn_corners"].values.mean(axis=1)
    radius = np.linalg.norm(centres, axis=1)
    outwards = (data["drawn_flux"].values * (centres / radius[:, None])).sum(axis=2)
    assert (outwards > 0).mean() > 0.99
    own = data["leakage"].values[data["drawn_corners"].attrs["realisation"]] * ring.leak_basis.length
    width = 2 * np.pi * radius / (len(radius) / len(np.unique(radius.round(9))))
    rows = np.unique(radius.round(9), return_inverse=True)[1]
    through = np.array([[(outwards[s] * width)[rows == n].sum() for n in range(rows.max() + 1)] for s in range(3)])
    assert_allclose(through, np.repeat(own[:, None], through.shape[1], axis=1), rtol=0.05)
    nominal = data["nominal_pressure"].values[:, None].repeat(len(radius), axis=1)
    # what the fluid leaves of the load at its place
    assert_allclose(data["drawn_window_pressure"] + data["drawn_fluid_pressure"].fillna(0.0) - 1e5, nominal, rtol=5e-3)


def test_pressures_of_a_map_are_those_of_their_places():
    scene = fs.Scene(
        fs.self_affine((32, 32), (30e-6, 30e-6), hurst=0.8, rms_slope=0.2, roll_off=20e-6, rng=2),
        115e9,
        3e9,
        FLUID,
        1e6,
        0.0,
        loading=(5e7, 3e8),
        fluid_pressure="ignored",
    )
    profile = Profile((0.5, 1.5))
    sampling = fs.Sampling(240e-6, 4, 4, 1, pressure="uniform", pressure_map=profile)
    drawn = fs.stochastic(scene, (4, 4), sampling)
    without = fs.stochastic(scene, (4, 4), replace(sampling, median_fields=False))
    assert without.median_seal is None
    assert_array_equal(without.leakage, drawn.leakage)
    seal = drawn.median_seal
    rows = seal.pressure.reshape(2, 4, -1)
    assert (np.diff(rows, axis=1) >= 0).all()
    assert_allclose(rows.mean(axis=(1, 2)), [5e7, 3e8])


def test_pictures_of_drawn_seals(strip, ring):
    titles = [axes.get_title() for axes in seal_figure(strip, 1).axes if axes.get_title()]
    assert [title.split(" [")[0].split(";")[0] for title in titles] == [
        "fluid pressure",
        "permeability",
        "fluid pressure",
        "flux",
        "contact pressure of windows",
        "permeability",
    ]
    first = seal_figure(strip, 1).axes[0]
    assert first.get_ylabel() == "x2 along the seal [mm]"
    assert_allclose(first.get_ylim(), (0, 0.24))
    titles = [axes.get_title() for axes in seal_figure(ring).axes if axes.get_title()]
    shown = ["fluid pressure", "permeability", "fluid pressure", "flux", "contact pressure of windows", "permeability"]
    assert [title.split(" [")[0].split(";")[0] for title in titles] == shown
    assert seal_figure(ring).axes[0].get_xlabel() == "x1 [mm]"


def test_files_of_drawn_seals_are_read_by_vtk_and_meshio(strip):
    folder, data = strip.folder, strip.dataset
    expected = {
        "permeability_m3": data["drawn_permeability"].values[1],
        "fluid_pressure_MPa": data["drawn_fluid_pressure"].values[1] / 1e6,
        "window_pressure_MPa": data["drawn_window_pressure"].values[1] / 1e6,
    }
    by_step = pyvista.get_reader(folder / "vtk" / "drawn.pvd")
    by_step.set_active_time_value(1.0)
    hdf = vtkHDFReader()
    hdf.SetFileName(str(folder / "vtk" / "drawn.vtkhdf"))
    hdf.UpdateInformation()
    hdf.UpdateTimeStep(1.0)
    plain = meshio.read(folder / "vtk" / "drawn" / "step_0001.vtu")
    for mesh in (by_step.read()[0], pyvista.wrap(hdf.GetOutput())):
        assert mesh.n_cells == data.sizes["part"]
        assert mesh.area == pytest.approx(30e-6 * 240e-6)
        for name, values in expected.items():
            assert_allclose(mesh.cell_data[name], values, rtol=1e-6)
        assert_allclose(mesh.cell_data["flux_m2_per_s"][:, :2], data["drawn_flux"].values[1], rtol=1e-6, atol=1e-30)
    assert_allclose(plain.cell_data["flux_m2_per_s"][0][:, :2], data["drawn_flux"].values[1], rtol=1e-6, atol=1e-30)
    back = open_results(folder)
    assert_allclose(back.dataset["drawn_flux"], data["drawn_flux"])


def test_gases_with_slip_have_fields_too(tmp_path):
    gas = {
        "kind": "ideal-gas",
        "viscosity": "0.02 mPa*s",
        "molar_mass": "4 g/mol",
        "temperature": "20 °C",
        "inlet_pressure": "1 MPa",
        "outlet_pressure": "0.1 MPa",
    }
    found = fs.run(parse_case(CASE | {"fluid": gas, "method": "stochastic"}), workers=1)
    data = found.dataset
    own = data["leakage"].values[data["drawn_corners"].attrs["realisation"]]
    flux = data["drawn_flux"].values.reshape(3, 2, -1, 2)[..., 0].mean(axis=2)
    assert_allclose(flux, np.repeat(own[:, None], 2, axis=1), rtol=1e-3)
    again = assemble(found.scene, stochastic=found.stochastic)
    assert write_vtk(again, None, tmp_path)
