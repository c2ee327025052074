"""What a drawn seal looks like: flux and contact pressure over its parts, in results, pictures and files."""

import meshio
import numpy as np
import pytest
import pyvista
from numpy.testing import assert_allclose
from small_cases import STRIP

import femseal as fs
from femseal.case import parse_case
from femseal.results import assemble, open_results, write_vtk

CASE = STRIP | {
    "stochastic": {"length": "240 um", "realisations": 5},
    "output": {"budget": False},
}
RING = {
    "seal": {"kind": "annular", "inner_radius": "0.15 mm", "outer_radius": "0.3 mm"},
    "stochastic": {"realisations": 5},
}


@pytest.fixture(scope="module")
def strip(tmp_path_factory):
    folder = tmp_path_factory.mktemp("strip") / "out"
    return fs.run(parse_case(CASE), folder, workers=1)


@pytest.fixture(scope="module")
def ring():
    return fs.run(parse_case(CASE | RING), workers=1)


def test_fields_are_those_of_one_realisation(strip):
    """Rows carry the leakage of the drawn tiles, and every tile has the pressure of a cell of its row."""
    data, cells = strip.dataset, strip.stochastic.cells
    own = data["leakage"].values[data["drawn_corners"].attrs["realisation"]]
    through = data["drawn_flux"].values.reshape(3, 2, -1, 2)[..., 0].mean(axis=2)
    assert_allclose(through[:, 0], through[:, 1], rtol=0.05)
    assert_allclose(
        through.mean(axis=1) * cells.surface_leakage / cells.cells_leakage, own, rtol=0.05
    )
    pressure = data["drawn_contact_pressure"].values
    for drawn, known in zip(pressure, cells.pressure, strict=True):
        for row, of_face in zip(drawn.reshape(2, -1), known, strict=True):
            assert set(row.round(3)) <= set(of_face.round(3))
    assert np.corrcoef(pressure[1], data["drawn_permeability"].values[1])[0, 1] < 0


def test_states_are_those_that_the_tiles_draw_from(strip, ring):
    for results in (strip, ring):
        data, cells = results.dataset, results.stochastic.cells
        for name, values in (
            ("state_k1", cells.k[:, 0].mean(axis=0)),
            ("state_k2", cells.k[:, 1].mean(axis=0)),
            ("state_pressure", cells.pressure),
            ("state_mean_gap", cells.mean_gap),
            ("state_contact_fraction", cells.contact_fraction),
            ("state_factor", cells.factor),
            ("state_leakage", cells.surface_leakage),
        ):
            assert_allclose(data[name], values, err_msg=name)
        assert_allclose(data["state_nominal_pressure"], cells.steps.pressures)
    assert strip.dataset.sizes["state"] == 3  # as broad as the face: at its own loads
    assert ring.dataset.sizes["state"] > 3


def test_fields_of_a_ring_flow_outwards(ring):
    data = ring.dataset
    centres = data["drawn_corners"].values.mean(axis=1)
    radius = np.linalg.norm(centres, axis=1)
    outwards = (data["drawn_flux"].values * (centres / radius[:, None])).sum(axis=2)
    assert (outwards > 0).mean() > 0.95
    leakage = data["leakage"].values[data["drawn_corners"].attrs["realisation"]]
    rows = np.unique(radius.round(9), return_inverse=True)[1]
    width = 2 * np.pi * radius / np.bincount(rows)[rows]
    for flux, total in zip(outwards * width, leakage * ring.leak_basis.length, strict=True):
        assert_allclose(np.bincount(rows, flux), total, rtol=0.1)
    # what the fluid leaves of the load at its place
    relief = ring.scene.acting_fluid.relief(data["drawn_fluid_pressure"].fillna(0.0).values)
    assert (relief.max(axis=1) > 5e5).all()
    left = data["drawn_contact_pressure"].values + relief
    assert_allclose(left, data["nominal_pressure"].values[:, None] + 0 * relief, rtol=1e-9)


def test_a_short_seal_is_drawn_once_as_a_whole():
    short = {"stochastic": {"length": "60 um", "realisations": 3}, "cells": {"count": [2, 2]}}
    found = fs.run(parse_case(CASE | short), workers=1)
    assert_allclose(found.leak_basis.length, 60e-6)  # columns are repeated for the elements alone
    assert_allclose(np.ptp(found.dataset["drawn_corners"].values, axis=(0, 1)), (30e-6, 60e-6))


def test_files_of_drawn_seals_are_read_by_vtk_and_meshio(strip):
    folder, data = strip.folder, strip.dataset
    by_step = pyvista.get_reader(folder / "vtk" / "drawn.pvd")
    by_step.set_active_time_value(1.0)
    plain = meshio.read(folder / "vtk" / "drawn" / "step_0001.vtu")
    mesh = by_step.read()[0]
    assert mesh.n_cells == data.sizes["part"]
    assert mesh.area == pytest.approx(30e-6 * 240e-6)
    for name, variable, unit in (
        ("permeability_m3", "drawn_permeability", 1),
        ("fluid_pressure_MPa", "drawn_fluid_pressure", 1e6),
        ("contact_pressure_MPa", "drawn_contact_pressure", 1e6),
    ):
        assert_allclose(mesh.cell_data[name], data[variable].values[1] / unit, rtol=1e-6)
    flux = data["drawn_flux"].values[1]
    for found in (mesh.cell_data["flux_m2_per_s"], plain.cell_data["flux_m2_per_s"][0]):
        assert_allclose(found[:, :2], flux, rtol=1e-6, atol=1e-30)
    assert_allclose(open_results(folder).dataset["drawn_flux"], data["drawn_flux"])


def test_states_are_in_files_with_their_number_as_time(ring, tmp_path):
    write_vtk(ring, None, tmp_path)
    data = ring.dataset
    reader = pyvista.get_reader(tmp_path / "states.pvd")
    assert reader.time_values == list(range(data.sizes["state"]))
    reader.set_active_time_value(data.sizes["state"] - 1)
    block = reader.read()[0]
    nominal = data["state_nominal_pressure"][-1:] / 1e6
    assert_allclose(block.field_data["nominal_pressure_MPa"], nominal)
    assert block.area == pytest.approx(30e-6 * 60e-6)
    x1, x2 = (data[name].values for name in ("state_cell1", "state_cell2"))
    assert_allclose(block.cell_centers().points[:, 0], np.repeat(x1, len(x2)), rtol=1e-6)
    assert_allclose(block.cell_data["k1_m3"], data["state_k1"][-1].values.ravel(), rtol=1e-6)


def test_gases_with_slip_have_fields_too(tmp_path):
    gas = {"name": "helium", "inlet_pressure": "1 MPa", "outlet_pressure": "0.1 MPa"}
    found = fs.run(parse_case(CASE | {"fluid": gas}), workers=1)
    flux = found.dataset["drawn_flux"].values.reshape(3, 2, -1, 2)[..., 0].mean(axis=2)
    assert_allclose(flux[:, 0], flux[:, 1], rtol=0.1)
    again = assemble(found.scene, found.stochastic)
    assert write_vtk(again, None, tmp_path)
