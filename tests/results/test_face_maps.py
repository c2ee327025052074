"""Deterministic runs have maps: in memory, in the dataset, for ParaView, in pictures and on the page."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from small_cases import steel_scene

import femseal as fs
from femseal.report import write_folder
from femseal.results import assemble
from femseal.results.variables import block_means

LOADS = (2e7, 2e8, 1.6e9)


@pytest.fixture(scope="module")
def scene():
    face = fs.self_affine(
        (32, 48), (60e-6, 90e-6), hurst=0.8, rms_slope=0.15, roll_off=30e-6, rng=2
    )
    way = {"loading": LOADS, "unload_from": (2e8,), "unloading": (2e7,)}
    return steel_scene(face, hardness=2.8e9, outlet_pressure=1e5, **way)


def test_the_panels_of_a_picture_are_those_maps(scene, study):
    results = assemble(scene, study)
    maps = results.plot_seal(1).axes[:3]
    names = [axes.images[0].colorbar.ax.get_xlabel() for axes in maps]
    assert names == ["contact pressure [MPa]", "gap [µm]", "fluid pressure [MPa]"]


@pytest.fixture(scope="module")
def study(scene):
    return fs.deterministic(scene)


@pytest.fixture(scope="module")
def folder(scene, study, tmp_path_factory):
    target = tmp_path_factory.mktemp("deterministic")
    results = assemble(scene, study)

    write_folder(results, target, scene.surface)
    return target


def test_fields_are_those_of_the_contact_and_of_the_flow(scene, study):
    body = fs.HalfSpace(scene.surface.shape, scene.surface.spacing, scene.modulus, scene.boundary)
    gap0 = scene.surface.heights.max() - scene.surface.heights
    contact = fs.solve_contact(
        gap0, body, pressure=LOADS[1], hardness=scene.hardness, rtol=scene.rtol
    )
    assert_allclose(study.contact_pressure[1], contact.pressure, rtol=1e-6)
    assert_allclose(study.contact_pressure[...].mean(axis=(1, 2)), scene.steps.pressures, rtol=1e-5)
    flow = fs.cell_permeability(contact.gap, scene.surface.spacing, sides="periodic")
    assert_allclose(study.fluid_pressure[1], 1e5 + 9e5 * flow.fluid_pressure, rtol=1e-5)
    assert study.fluid_pressure.dtype == study.gap.dtype == np.float32
    # no fluid in contact; the rest of what is undefined are pockets
    assert np.isnan(study.fluid_pressure[study.gap == 0]).all()
    closed = study.leakage == 0
    assert closed.any()
    standing = study.fluid_pressure[closed]
    assert set(np.unique(standing[np.isfinite(standing)]).round()) <= {1e5, 1e6}


def test_the_dataset_has_their_means_over_blocks(scene, study, folder):
    data = fs.open_results(folder).dataset
    assert data["face_gap"].shape == study.gap.shape  # a small face has a block for each pixel
    assert_allclose(data["face_gap"], study.gap)
    assert_allclose(data["face_contact_pressure"], study.contact_pressure)
    assert_allclose(data["face_fluid_pressure"], study.fluid_pressure)
    assert_allclose(data["block1"][[0, -1]], [60e-6 / 64, 60e-6 * 63 / 64])
    assert_allclose(data["face_height"], scene.surface.heights, atol=1e-12)


def test_means_over_blocks():
    values = np.arange(35.0).reshape(5, 7)
    values[0, :4] = np.nan
    found = block_means(values, 2)
    upper = np.mean([7, 8, 9]), np.mean([4, 5, 6, 10, 11, 12, 13])
    assert_allclose(found, [upper, [values[2:, :3].mean(), values[2:, 3:].mean()]])
    assert np.isnan(block_means(np.full((4, 4), np.nan), 2)).all()
    assert_allclose(block_means(values, 9)[1:], values[1:])
