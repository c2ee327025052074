"""Numbers that stand for points which were not measured: named by the file or the caller, or recognised."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal

import femseal as fs
from femseal.base import InputError
from femseal.case import parse_case
from femseal.preparation import prepare
from femseal.topography import read_for_a_look, self_affine, turned

N = 48
FACE = self_affine((N, N), (96e-6, 96e-6), hurst=0.8, rms_height=1e-6, rng=1).heights
HOLE = np.zeros((N, N), dtype=bool)
HOLE[10:14, 20:25] = HOLE[0, 0] = True
SAID = {"spacing": (2e-6, 2e-6), "height_unit": "um"}


def look(folder, heights, **said):
    """A text of heights [µm], which it holds to nine digits."""
    np.savetxt(folder / "face.txt", heights, "%.9g")
    return read_for_a_look(folder / "face.txt", **SAID, **said)


def holed(value, heights=FACE, hole=HOLE):
    """Heights [µm] with a number in place of those in a hole."""
    return np.where(hole, value, 1e6 * heights)


@pytest.mark.parametrize(
    "value", [-9999, 9999, 32767, -32768, -99999.9999, 65535, 1000001, 1.70141e38, -3.40282e38]
)
def test_marks_that_programs_write_are_undefined_and_noted(tmp_path, value):
    found = look(tmp_path, holed(value))
    assert not found.errors
    assert_array_equal(np.isnan(found.topography.heights), HOLE.T)
    assert f"21 points (0.911 %) at exactly {value:g}, far from all others" in found.notes[0]
    assert "no_data = 'none' keeps them" in found.notes[0]
    # a single one as well, and two kinds
    one = HOLE & (np.arange(N) == 0)
    both = np.where(one, -9999.0, holed(value, hole=HOLE & ~one))
    assert_array_equal(np.isnan(look(tmp_path, both).topography.heights), HOLE.T)


@pytest.mark.parametrize(("value", "offset"), [(0, 12), (0, -12), (-50, 0), (100, 0)])
def test_other_numbers_far_from_all_heights_are_refused_with_a_question(tmp_path, value, offset):
    """Such as 0, whose points may be a stop as well; a tilt of the face, of 5 µm here, changes nothing."""
    tilt = 5e-6 * np.arange(N) / N
    heights = holed(value, FACE + tilt + 1e-6 * offset)
    error = look(tmp_path, heights).errors[0]
    assert f"21 points (0.911 %) at exactly {value:g}, far from all others" in str(error)
    assert f"no_data={value:g} (--no-data {value:g}) such points count" in str(error)
    with pytest.raises(InputError, match="far from all others"):
        fs.read_topography(tmp_path / "face.txt", **SAID)
    assert_array_equal(np.isnan(look(tmp_path, heights, no_data=value).topography.heights), HOLE.T)
    kept = look(tmp_path, heights, no_data="none")
    assert not kept.errors
    assert not kept.topography.undefined_fraction


def test_marks_are_found_in_arrays_as_well(tmp_path):
    np.savez(tmp_path / "face.npz", z=np.where(HOLE, 32767, FACE), spacing=(2e-6, 2e-6))
    found = read_for_a_look(tmp_path / "face.npz")
    assert not found.errors
    assert_array_equal(np.isnan(found.topography.heights), HOLE)


def quantised(heights, levels):
    low, high = heights.min(), heights.max()
    return np.round((heights - low) / (high - low) * levels)


@pytest.mark.parametrize(
    "heights",
    [
        1e6 * FACE,
        quantised(FACE, 12),  # counts of few bits
        quantised(FACE, 32767),
        np.maximum(1e6 * FACE, -0.5),  # clipped by the instrument
        1e6 * np.maximum(FACE, np.quantile(FACE, 0.9)),
        1e6
        * turned((N, N), (96e-6, 96e-6), pitch=24e-6, depth=2e-6, nose_radius=1e-4, rng=1).heights,
        np.where(HOLE, -5.0, 0.0),  # two levels, and three
        np.where(HOLE, -5.0, np.arange(N) % 2),
        np.where(HOLE & (np.arange(N) == 0), 1000.0, 1e6 * FACE),  # a spike
    ],
)
def test_measured_surfaces_without_marks_stay_unchanged(tmp_path, heights):
    found = look(tmp_path, heights)
    assert not found.errors
    assert not found.notes
    assert not found.topography.undefined_fraction


def test_no_data_must_be_a_number_or_none(tmp_path):
    for wrong in ("no", np.nan, []):
        with pytest.raises(InputError, match=r"no_data: given .*, expected a number, or 'none'"):
            look(tmp_path, holed(0), no_data=wrong)


def test_a_case_takes_marks_for_undefined_points_and_warns(tmp_path):
    np.savetxt(tmp_path / "face.txt", holed(-9999), "%.6g")
    face = {"kind": "file", "path": "face.txt", "spacing": ["2 um", "2 um"], "height_unit": "um"}
    case = {
        "method": "deterministic",
        "face": face,
        "material": {"young": "200 GPa", "poisson": 0.3},
        "load": {"loading": ["10 MPa"]},
        "fluid": {"name": "water", "inlet_pressure": "1 bar"},
    }
    prepared = prepare(parse_case(case, tmp_path))
    assert prepared.conditioning.undefined_fraction == HOLE.mean()
    assert any(text.startswith("face.txt: 21 points") for text in prepared.warnings)
    case["face"] = face | {"no_data": -9999}
    texts = prepare(parse_case(case, tmp_path)).warnings
    assert any("at -9999: undefined, as no_data says" in text for text in texts)
    case["face"] = face | {"no_data": "zero"}
    with pytest.raises(InputError, match=r"face\.no_data"):
        parse_case(case, tmp_path)
