"""The case that a calibration writes: its hardness and shortest wave, and the names of its files."""

import tomllib
from types import SimpleNamespace

from femseal.calibration.calibrated_case import calibrated_text


def median(value):
    return SimpleNamespace(median=value)


def test_the_case_has_the_medians_and_finds_its_files_from_its_own_folder(tmp_path):
    (tmp_path / "case").mkdir()
    for name in ("face.txt", "lay.vtu"):
        (tmp_path / "case" / name).touch()
    tables = {
        "face": {"path": "face.txt", "unit": "um"},
        "seal": {"lay": "lay.vtu:angle"},
        "surface": {"detrend": 2},
        "material": {"young": "210 GPa"},
        "counter_material": {"yield_stress": "1 GPa", "hardness_over_yield": 3},
    }
    calibration = SimpleNamespace(
        solid="counter_material",
        hardness=median(3.2e9),
        shortest_wave=median(12e-6),
        factor=median(1.4),
    )
    text = calibrated_text(tables, tmp_path / "case", tmp_path / "out", calibration)
    assert tomllib.loads(text) == {
        "face": {"path": "../case/face.txt", "unit": "um"},
        "seal": {"lay": "../case/lay.vtu:angle"},
        "surface": {"detrend": 2, "shortest_wave": "12 um"},
        "material": {"young": "210 GPa"},
        "counter_material": {"hardness": "3.2 GPa"},
    }
    assert "leaked 1.4 times as much" in text
