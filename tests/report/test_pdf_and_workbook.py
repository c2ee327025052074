"""The report as PDF, the table as a workbook, and the verdict at the head of the page."""

import json
import os
import sys

import numpy as np
import openpyxl
import pytest

import femseal as fs
from femseal import cli
from femseal.base.errors import FemsealError, InputError
from femseal.base.text import comma_separated
from femseal.report import page as report_page
from femseal.report import write_pdf
from femseal.report.leakage_tables import class_table, limiting_text
from femseal.results import RunFacts, assemble
from femseal.results.tables import rows, write_workbook
from femseal.studies import Scene
from femseal.studies.face_study import deterministic

PAGE = '<!DOCTYPE html>\n<html><body><p id="text">A page.</p></body></html>\n'


@pytest.fixture(scope="module")
def scene():
    surface = fs.self_affine(
        (32, 32), (40e-6, 40e-6), hurst=0.8, rms_slope=0.15, roll_off=20e-6, rng=2
    )
    cycle = {"loading": (50e6, 200e6, 2.5e9), "unload_from": (200e6,), "unloading": (50e6,)}
    return Scene(surface, 115e9, 2.8e9, fs.Liquid(1e-3), 1e6, 0.0, **cycle)


@pytest.fixture(scope="module")
def study(scene):
    return deterministic(scene)


def test_what_widens_the_band_of_error_most_is_told(scene, study):
    data = assemble(scene, study).dataset.copy()
    leakage = data["leakage_deterministic"].values
    data.attrs["error_budget"] = json.dumps({"deterministic": {"pixels": "by hand"}})
    for end, factor in (("lower", 0.5), ("upper", 2.0)):
        ends = (
            factor * leakage if end == "lower" else np.where(leakage > 0, factor * leakage, np.inf)
        )
        data[f"leakage_deterministic_budget_part_{end}"] = (("budget_part", "step"), ends[None])
    results = fs.Results(data.assign_coords(budget_part=["pixels"]))
    assert limiting_text(results).startswith(
        "One end of the band of error at loading 2.5 GPa is unknown"
    )
    assert limiting_text(results).endswith("its widest source: pixels.")


def test_verdict_is_the_first_load_that_meets_the_class(scene, study):
    density = scene.fluid.density
    middle = float(np.sqrt(study.leakage[0] * study.leakage[1])) * density
    results = assemble(
        scene, study, facts=RunFacts(classes=[f"{1e6 * middle:g} mg/(m·s)", "1 kg/(m·s)"])
    )
    table = class_table(results)
    assert table.heads == (
        "class",
        "limit",
        "met by the seal",
        "in service, unloading from 200 MPa",
    )
    (_, limit, met, kept), (_, _, always, _) = table.lines
    assert limit == f"{1e6 * middle:.3g} mg/(m·s)"
    assert met == "from 200 MPa"
    assert always == "at every load step"
    assert kept == f"kept down to {'50' if study.leakage[3] * density <= middle else '200'} MPa"
    assert limiting_text(results) == ""


def test_texts_of_a_spreadsheet_are_never_formulas(scene, study, tmp_path):
    lines = comma_separated(
        [{"=key": "=1+2", "b": "@x", "c": "-2 um", "d": -2.0, "e": "-3"}]
    ).splitlines()
    assert lines == ["'=key,b,c,d,e", "'=1+2,'@x,'-2 um,-2.0,-3"]
    results = assemble(scene, study)
    sheet = openpyxl.load_workbook(write_workbook(results, tmp_path / "table.xlsx")).active
    table = rows(results)
    names = [cell.value for cell in sheet[1]]
    assert names == list(table[0])
    for n, row in enumerate(table, 2):
        for name, cell in zip(names, sheet[n], strict=True):
            expected = None if isinstance(row[name], float) and np.isnan(row[name]) else row[name]
            assert cell.data_type != "f"
            assert cell.value == (
                pytest.approx(expected, rel=1e-14) if isinstance(expected, float) else expected
            )


def test_a_workbook_keeps_a_text_that_looks_like_a_formula(scene, study, tmp_path, monkeypatch):
    monkeypatch.setattr(
        "femseal.results.tables.rows", lambda run: [{"=name": "=1+2", "value": 1.0}]
    )
    results = assemble(scene, study)
    sheet = openpyxl.load_workbook(write_workbook(results, tmp_path / "table.xlsx")).active
    assert [(cell.value, cell.data_type) for cell in (sheet["A1"], sheet["A2"])] == [
        ("=name", "s"),
        ("=1+2", "s"),
    ]


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
def test_a_browser_prints(tmp_path, monkeypatch, capsys, scene, study):
    browser = tmp_path / "chromium"
    browser.write_text(
        "#!/bin/sh\n"
        'for a in "$@"; do case "$a" in --print-to-pdf=*) to="${a#--print-to-pdf=}";; esac; done\n'
        "case \"$a\" in file:///*good*) printf %s '%PDF-1.4' > \"$to\";; *) echo 'no printer' >&2; exit 1;; esac\n"
    )
    browser.chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}")
    monkeypatch.setattr("femseal.report.write_report", lambda folder, output: output)
    good, bad = tmp_path / "good page.html", tmp_path / "bad.html"
    for page in (good, bad):
        page.write_text(PAGE)
    monkeypatch.setattr(sys, "argv", ["femseal", "report", str(tmp_path), "-o", str(good), "--pdf"])
    cli.main()
    assert capsys.readouterr().out.split("\n")[:2] == [str(good), str(tmp_path / "good page.pdf")]
    assert (tmp_path / "good page.pdf").read_bytes() == b"%PDF-1.4"
    with pytest.raises(FemsealError, match=r"did not print the page .*no printer"):
        write_pdf(bad)
    assert not (tmp_path / "bad.pdf").exists()
