"""The shortest wave that an instrument sees, and what lies beyond it: closed forms, and a run that knows it."""

from math import gamma, pi, sqrt

import numpy as np
import pytest
from numpy.testing import assert_allclose
from small_cases import HARDENED

import femseal as fs
from femseal.budget.versions import kept_slope
from femseal.case import parse_case
from femseal.preparation import prepare
from femseal.topography import Instrument, Patches, condition, read_for_a_look

AMPLITUDE, RADIUS = 1e-6, 2e-6
#: The shortest wave of that amplitude that a tip of that radius follows.
LIMIT = 2 * pi * sqrt(AMPLITUDE * RADIUS)


def wave(length, axis=0, periods=8):
    """A wave along an axis, of the amplitude."""
    x = (np.arange(32 * periods) + 0.5) / 32
    z = np.tile(AMPLITUDE * np.cos(2 * pi * x), (4, 1))
    return fs.Topography(z if axis else z.T, (length / 32, length / 32))


@pytest.mark.parametrize("axis", [0, 1])
def test_a_tip_follows_a_wave_that_is_blunter(axis):
    tip = Instrument(tip_radius=RADIUS)
    assert tip.shortest_wave(wave(1.01 * LIMIT, axis)) == 0
    # of the waves of the map the next longer one is seen: 7 in place of 8 periods
    assert_allclose(tip.shortest_wave(wave(0.99 * LIMIT, axis)), 0.99 * LIMIT * 8 / 7)
    assert tip.shortest_wave(wave(0.99 * LIMIT, axis).with_heights(wave(1, axis).heights / 2)) == 0


def affine(n, spacing=1e-6, **given):
    size = (n * spacing, n * spacing)
    return fs.self_affine((n, n), size, **({"hurst": 0.8, "rms_slope": 0.1, "rng": 1} | given))


def conditioned(face, resolution, **given):
    instrument = Instrument(resolution=resolution)
    return condition(face, detrend=0, instrument=instrument, **given)


def test_the_shortest_wave_that_a_tip_follows_agrees_with_the_spectrum():
    """C = C0 q^(−2−2H) has profiles of C0 Γ(H + 1/2)/(2√π Γ(1 + H)) q^(−1−2H), whose curvature is (1/π)∫q⁴C dq."""
    face = affine(512, 1e-3 / 512, rms_slope=0.3, roll_off=2.5e-4, cut_off=5e-6)
    radius = 40e-6
    q, density = face.radial_psd()
    law = (q > 2 * pi / 2e-4) & (q < 2 * pi / 6e-6)
    c0 = np.exp(np.mean(np.log(density[law] * q[law] ** 3.6)))
    of_profiles = c0 * gamma(1.3) / (2 * sqrt(pi) * gamma(1.8))
    end = (2.4 * pi / (2 * of_profiles * radius**2)) ** (1 / 2.4)
    assert_allclose(Instrument(tip_radius=radius).shortest_wave(face), 2 * pi / end, rtol=0.05)


def test_the_worse_of_tip_and_resolution_and_of_several_patches_counts():
    sharp, blunt = wave(1.5 * LIMIT), wave(0.8 * LIMIT)
    assert Instrument(resolution=3e-6).shortest_wave(sharp) == 3e-6
    assert Instrument().shortest_wave(sharp) == 0
    both = Instrument(RADIUS, resolution=3e-6)
    assert both.shortest_wave(sharp) == 3e-6
    assert_allclose(both.shortest_wave(blunt), 0.8 * LIMIT * 8 / 7)
    faces = [affine(96, rms_slope=s, rng=n) for n, s in ((1, 0.1), (2, 0.2))]
    tip = Instrument(tip_radius=20e-6)
    assert tip.shortest_wave(Patches(faces)) == max(tip.shortest_wave(face) for face in faces) > 0


MEASURED = affine(256, cut_off=2e-6)


def test_the_low_pass_is_no_shorter_than_what_the_instrument_sees():
    plain, seen = (conditioned(MEASURED, resolution)[1] for resolution in (None, 16e-6))
    assert plain.shortest_wave == 8e-6
    assert (plain.shortest_seen, plain.unseen_slope, plain.unseen) == (None, None, "")
    assert seen.shortest_wave == seen.shortest_seen == seen.shortest_measured == 16e-6
    asked, _ = conditioned(MEASURED, 16e-6, shortest_wave=8e-6)
    assert_allclose(asked.heights, MEASURED.low_pass(8e-6).heights, atol=1e-18)


def test_the_unseen_slope_is_that_of_the_waves_that_the_instrument_does_not_see():
    """Of a face with waves down to a tenth of those seen: the slope of its own waves."""
    whole = affine(1024, 2.56e-4 / 1024, cut_off=2e-6)
    _, report = conditioned(whole, 20e-6, shape=(256, 256))
    beyond = sqrt(whole.rms_slope**2 - whole.low_pass(20e-6).rms_slope ** 2)
    assert_allclose(report.unseen_slope, beyond, rtol=0.05)
    # what the low-pass removes of the waves that were seen comes on top
    _, more = conditioned(whole, 20e-6, shape=(256, 256), shortest_wave=40e-6)
    for found, cut in ((report, 20e-6), (more, 40e-6)):
        kept = whole.low_pass(cut).rms_slope / whole.rms_slope
        assert_allclose(found.kept_slope, kept, rtol=0.03)


def test_without_a_power_law_the_slope_of_unseen_waves_in_the_map_counts_as_removed():
    longer = wave(1e-4)
    x = (np.arange(longer.shape[0]) + 0.5) * longer.spacing[0]
    short = AMPLITUDE / 8 * np.cos(2 * pi * x / 2.5e-5)[:, None]
    face = longer.with_heights(longer.heights + short)
    _, report = conditioned(face, 5e-5)
    assert report.unseen_slope is None
    assert "no power law" in report.unseen
    assert_allclose(report.kept_slope, longer.rms_slope / face.rms_slope)


def test_a_file_or_the_caller_says_what_the_instrument_is(tmp_path):
    surfaces = pytest.importorskip("SurfaceTopography")
    said = {"tip_radius": {"value": 5, "unit": "µm"}, "resolution": {"value": 500, "unit": "nm"}}
    for parameters, expected in (
        (said, Instrument(pytest.approx(5e-6), pytest.approx(5e-7))),
        ({"tip_radius": {"value": 2.0}}, Instrument()),
    ):
        info = {"instrument": {"name": "stylus", "parameters": parameters}}
        made = surfaces.Topography(MEASURED.heights * 1e6, (256.0, 256.0), unit="µm", info=info)
        path = tmp_path / "face.nc"
        path.unlink(missing_ok=True)
        made.to_netcdf(str(path))
        assert read_for_a_look(path).instrument == expected
    assert read_for_a_look(path, tip_radius=5e-6).instrument == Instrument(tip_radius=5e-6)
    with pytest.raises(fs.InputError, match="resolution: given"):
        read_for_a_look(path, resolution=-1)


# --- a case -----------------------------------------------------------------------------------------------


def test_a_case_says_what_its_instrument_does_not_see(tmp_path):
    np.savez(tmp_path / "face.npz", z=MEASURED.heights, spacing=MEASURED.spacing)
    face = {"kind": "file", "path": "face.npz", "periodic": [True, True]}
    plain, made = (
        prepare(parse_case(HARDENED | {"face": face | more, "surface": {"detrend": 0}}, tmp_path))
        for more in ({}, {"resolution": "16 um"})
    )
    assert made.conditioning.shortest_wave == 16e-6 > plain.conditioning.shortest_wave
    assert kept_slope(made) < 0.9 < kept_slope(plain)
