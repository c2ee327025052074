"""The table as a workbook, and the verdict at the head of the page."""

import numpy as np
import openpyxl
import pytest
from small_cases import steel_scene

import femseal as fs
from femseal.base import InputError, comma_separated
from femseal.report.report_tables import class_table
from femseal.results import RunFacts, assemble, rows
from femseal.results.tables import write_workbook


@pytest.fixture(scope="module")
def scene():
    surface = fs.self_affine(
        (32, 32), (40e-6, 40e-6), hurst=0.8, rms_slope=0.15, roll_off=20e-6, rng=2
    )
    cycle = {"loading": (50e6, 200e6, 2.5e9), "unload_from": (200e6,), "unloading": (50e6,)}
    return steel_scene(surface, hardness=2.8e9, fluid_pressure="acts", **cycle)


@pytest.fixture(scope="module")
def study(scene):
    return fs.deterministic(scene)


def test_verdict_is_the_first_load_that_meets_the_class(scene, study):
    density = scene.fluid.density
    middle = float(np.sqrt(study.leakage[0] * study.leakage[1])) * density
    classes = [f"{1e6 * middle:g} mg/(m·s)", "1 kg/(m·s)"]
    table = class_table(assemble(scene, study, facts=RunFacts(classes=classes)))
    (name, met, kept), (_, always, never_lost) = table.lines
    assert name == f"{1e6 * middle:g} mg/(m·s)"
    # half way between both loads in ln(leakage) over ln(pressure)
    assert (met, always) == ("from 100 MPa on", "at every load from 50 MPa on")
    assert kept.startswith("down to ")
    assert ("lowest" in kept) == (study.leakage[3] * density <= middle)
    assert never_lost == "down to the lowest load of 50 MPa"


def test_texts_of_a_spreadsheet_are_never_formulas(scene, study, tmp_path):
    found = comma_separated([{"=key": "=1+2", "b": "@x", "c": "-2 um", "d": -2.0, "e": "-3"}])
    assert found.splitlines() == ["'=key,b,c,d,e", "'=1+2,'@x,'-2 um,-2.0,-3"]
    results = assemble(scene, study)
    sheet = openpyxl.load_workbook(write_workbook(results, tmp_path / "table.xlsx")).active
    table = rows(results)
    assert [cell.value for cell in sheet[1]] == list(table[0])
    assert not any(cell.data_type == "f" for line in sheet for cell in line)
    for row, cells in zip(table, sheet.iter_rows(min_row=2, values_only=True), strict=True):
        for expected, found in zip(row.values(), cells, strict=True):
            unknown = isinstance(expected, float) and np.isnan(expected)
            number = isinstance(expected, float)
            assert found == (
                None if unknown else pytest.approx(expected, rel=1e-14) if number else expected
            )


def test_a_pdf_is_printed_from_a_browser(tmp_path):
    """The removed option says what to do instead, before anything is written."""
    from femseal.cli import app

    with pytest.raises(InputError, match=r"--pdf: given .*removed; open report\.html in a browser"):
        app(["report", str(tmp_path), "--pdf"], standalone_mode=False)
    assert not any(tmp_path.iterdir())
