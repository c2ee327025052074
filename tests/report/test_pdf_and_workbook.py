"""The report as PDF, the table as a workbook, and the verdict at the head of the page."""

import os

import numpy as np
import openpyxl
import pytest
from small_cases import steel_scene

import femseal as fs
from femseal.base import FemsealError, InputError, comma_separated
from femseal.report import page as report_page
from femseal.report import write_pdf
from femseal.report.report_tables import class_table
from femseal.results import RunFacts, assemble, rows
from femseal.results.tables import write_workbook

PAGE = '<!DOCTYPE html>\n<html><body><p id="text">A page.</p></body></html>\n'


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


# --- PDF --------------------------------------------------------------------------------------------------


def test_without_a_browser_the_error_says_what_is_needed(tmp_path, monkeypatch):
    (tmp_path / "page.html").write_text(PAGE)
    monkeypatch.setattr(report_page, "find_browser", lambda: None)
    monkeypatch.setattr(report_page, "find_spec", lambda name: None)
    with pytest.raises(
        InputError, match=r"no program that prints a page.*chromium.*pip install weasyprint"
    ):
        write_pdf(tmp_path / "page.html")
    assert [path.name for path in tmp_path.iterdir()] == ["page.html"]


@pytest.mark.skipif(os.name == "nt", reason="the browser that stands in is a script")
def test_a_browser_prints(tmp_path, monkeypatch):
    browser = tmp_path / "chromium"
    browser.write_text(
        "#!/bin/sh\n"
        'for a in "$@"; do case "$a" in --print-to-pdf=*) to="${a#--print-to-pdf=}";; esac; done\n'
        "case \"$a\" in file:///*good*) printf %s '%PDF-1.4' > \"$to\";; *) echo 'no printer' >&2; exit 1;; esac\n"
    )
    browser.chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}")
    good, bad = tmp_path / "good page.html", tmp_path / "bad.html"
    for page in (good, bad):
        page.write_text(PAGE)
    assert write_pdf(good) == tmp_path / "good page.pdf"
    assert (tmp_path / "good page.pdf").read_bytes() == b"%PDF-1.4"
    with pytest.raises(FemsealError, match=r"did not print the page .*no printer"):
        write_pdf(bad)
    assert not (tmp_path / "bad.pdf").exists()
