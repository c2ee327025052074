"""Conditioning: what it removes and keeps, what it reports, and how much memory it takes."""

import subprocess
import sys
import tracemalloc

import numpy as np
import pytest
from numpy.testing import assert_allclose
from waves_and_noise import SIZE, pixel_centres, standing_wave

from femseal.base import InputError
from femseal.topography import (
    Topography,
    condition,
    describe_surface,
    form_fit,
    self_affine,
)


def test_a_periodic_map_is_not_levelled_unless_asked_for():
    """Self-affine without a plateau: the plane fitted to it is a part of its waves."""
    face = self_affine((128, 128), SIZE, hurst=0.8, rms_slope=0.2, rng=1)
    kept, report = condition(face)
    assert_allclose(kept.rms_slope, 0.2, rtol=1e-9)
    assert report.removed_tilt == (0.0, 0.0)
    assert_allclose(describe_surface(face).rms_slope, 0.2, rtol=1e-9)
    # the plane through a single wave leaves a step of twice its amplitude
    single = standing_wave((128, 128), (1, 0), (True, True), phase=(-0.5 * np.pi, 0.0))
    assert single.seamless == (True, True)
    assert single.detrend(1).seamless == (False, True)
    slope = single.rms_slope
    assert_allclose(condition(single)[0].rms_slope, slope, rtol=1e-9)
    assert condition(single, detrend=1)[0].rms_slope > 1.5 * slope


@pytest.mark.parametrize("periodic", [(True, True), (False, True), (False, False)])
def test_a_measured_map_is_levelled_whatever_its_borders_are_called(periodic):
    """Part of a larger map, with a tilt: it has a step where it would repeat itself."""
    larger = self_affine((128, 256), SIZE, hurst=0.8, rms_slope=0.2, rng=1).heights[:, :128]
    tilt = 0.3 * SIZE[1] / 256
    measured = Topography(larger + tilt * np.arange(128), (SIZE[0] / 128, SIZE[1] / 256), periodic)
    form = measured.form()
    assert_allclose(form.slopes[1], measured.form(1).slopes[1], rtol=1e-9)
    assert_allclose(measured.detrend(None).form(1).slopes[1], 0, atol=1e-12)
    # along x1 the map repeats itself
    is_levelled = form.slopes[0] != 0
    assert is_levelled == (not periodic[0])


CONDITION = """
from math import inf
import numpy as np
from femseal.base.machine import peak_memory
from femseal.topography import Topography, condition

used = []
for n in (64, 2048):  # the first map loads what conditioning takes
    heights = np.random.default_rng(1).standard_normal((n, n))
    heights.flags.writeable = False
    measured = Topography(heights, (1e-6, 1e-6), (True, True))
    used.append(peak_memory())
    condition(measured, spikes=inf)
    used.append(peak_memory())
print(used[-1] - used[-2])
"""


def test_conditioning_of_a_periodic_map_takes_less_memory_than_a_contact():
    """Peak memory of a process of its own, which also contains what the transforms allocate themselves."""
    done = subprocess.run(
        [sys.executable, "-c", CONDITION], capture_output=True, text=True, check=True
    )
    map_bytes = 8
    assert int(done.stdout) < (37 - map_bytes) * 2048**2


@pytest.mark.parametrize(("kind", "bytes_per_point"), [("plain", 37), ("with spikes", 50)])
def test_conditioning_takes_little_memory(kind, bytes_per_point, monkeypatch):
    """Peak of what NumPy allocates, with the map; a contact takes 37 bytes a point.

    Blocks are as small beside this map as they are beside a large one.
    """
    monkeypatch.setattr(form_fit, "_BLOCK", 2**10)
    rng = np.random.default_rng(1)
    z = rng.standard_normal((512, 512))
    if kind == "with spikes":
        z[5::101, 3::89] = np.nan
        z[7::97, 2::103] += 100
    measured = Topography(z, (1e-6, 1e-6), (False, False))
    condition(measured)  # what is loaded once stays
    tracemalloc.start()
    condition(measured)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak + z.nbytes < bytes_per_point * z.size


def measured():
    """A tilted rough map with a few undefined points: self-affine roughness down to two pixels."""
    rough = self_affine((96, 80), SIZE, hurst=0.8, rms_height=1e-6, cut_off=7e-5, rng=4)
    x1, x2 = pixel_centres(rough.shape)
    z = rough.heights + np.tan(2e-3) * x1[:, None] - np.tan(1e-3) * x2
    z[40:42, 30:33] = np.nan
    return Topography(z, rough.spacing, (False, False))


def test_condition_reports_what_it_did():
    face, report = condition(measured())
    assert_allclose(report.undefined_fraction, 6 / (96 * 80))
    assert_allclose(report.removed_tilt, (2e-3, -1e-3), atol=5e-4)
    assert_allclose(report.shortest_wave, 8 * max(face.spacing))
    assert report.rms_height < report.rms_height_before < measured().fill_undefined().rms_height
    assert report.rms_slope < report.rms_slope_before
    assert_allclose((report.rms_height, report.rms_slope), (face.rms_height, face.rms_slope))
    assert (report.shape, report.spacing) == (face.shape, face.spacing)
    assert face.undefined_fraction == 0
    # Nothing shorter than the shortest wave is left.
    assert_allclose(face.high_pass(report.shortest_wave).heights, 0, atol=1e-18)


def test_condition_recovers_tilt_and_curvature():
    x1, x2 = pixel_centres((60, 50))
    u, v = x1[:, None] - SIZE[0] / 2, x2 - SIZE[1] / 2
    z = np.tan(1e-3) * u - np.tan(3e-3) * v + 0.5 * 2.0 * u**2 + 0.7 * u * v - 0.5 * 3.0 * v**2
    _, report = condition(Topography(z, (SIZE[0] / 60, SIZE[1] / 50)), detrend=2)
    assert_allclose(report.removed_tilt, (1e-3, -3e-3), rtol=1e-9)
    assert_allclose(report.removed_curvature, (2.0, 0.7, -3.0), rtol=1e-9)
    assert report.rms_height < 1e-15


def test_conditioning_on_another_grid_keeps_the_long_waves():
    face, report = condition(measured(), shape=(240, 200), shortest_wave=1.1e-4)
    assert face.shape == (240, 200)
    assert report.shape_before == (96, 80)
    assert_allclose(face.size, SIZE)
    coarse, report = condition(measured(), shape=(48, 40))
    assert_allclose(report.shortest_wave, 8 * max(coarse.spacing))
    reference, _ = condition(measured(), shortest_wave=report.shortest_wave)
    assert_allclose(coarse.resample((96, 80)).heights, reference.heights, atol=1e-18)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"shortest_wave": 1e-4}, r"wave: given 100 µm, .* 8 pixels = 250 µm.*shape=\(240, 160\)"),
        ({"shortest_wave": 0.1}, "less than the larger side, 3 mm"),
        ({"max_undefined": 1e-4}, "undefined points"),
    ],
)
def test_maps_that_cannot_be_conditioned_are_refused(given, message):
    with pytest.raises(InputError, match=f"(?s){message}"):
        condition(measured(), **given)
    assert condition(measured(), shortest_wave=1e-4, shape=(240, 160))[0].shape == (240, 160)


def test_an_automatic_grid_checks_the_shortest_wave_like_a_given_one():
    face = self_affine((32, 32), (32e-6, 32e-6), hurst=0.8, rms_slope=0.1, rng=1)
    for shortest_wave in (-1.0, 0.0, np.nan, "30 um"):
        for shape in ("auto", (32, 32), None):
            with pytest.raises(InputError, match="shortest_wave"):
                condition(face, shortest_wave=shortest_wave, shape=shape)
    assert condition(face, shape=np.array([32, 32]))[0].shape == (32, 32)
