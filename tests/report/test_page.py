"""The report: one page that stands by itself, says what the dataset says, and can be read everywhere."""

import json
import re
import shutil
import subprocess
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest
from numpy.testing import assert_allclose
from small_cases import soft_cycle, steel_scene

from femseal.base import InputError
from femseal.base.leak_units import leakage_unit
from femseal.report import write_report
from femseal.report.page import report_html
from femseal.results import RunFacts, assemble, save
from femseal.studies import Sampling, deterministic, stochastic, two_scale
from femseal.topography import Patches, self_affine

pytestmark = pytest.mark.usefixtures("drawn_pictures")

SECTIONS = [
    "leakage",
    "maps",
    "cells",
    "case",
    "numbers",
    "errors",
    "time",
    "warnings",
    "versions",
    "values",
]
CASE = {
    "title": "Trial <of> a seal & more",
    "seed": 7,
    "contact": {"rtol": 1e-5},
    "cells": {"count": [3, 6]},
    "face": [{"kind": "file", "path": "Face_A.x3p"}],
    "fluid": {"kind": "liquid", "viscosity": 1e-3},
}
SURFACE = {
    "shape": [48, 96],
    "spacing": [1e-6, 1e-6],
    "shortest_wave": 8e-6,
    "rms_height": 1e-6,
    "rms_slope": 0.15,
    "rms_slope_before": 0.2,
    "undefined_fraction": 0.0,
}
BROWSER = next(
    filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None
)


@pytest.fixture(scope="module")
def scene():
    return soft_cycle((48, 96))


@pytest.fixture(scope="module")
def studies(scene):
    return {
        "deterministic": deterministic(scene),
        "two_scale": two_scale(scene, (3, 6)),
        "stochastic": stochastic(scene, (3, 6), Sampling(240e-6, 20, seed=7)),
    }


@pytest.fixture(scope="module")
def results(scene, studies):
    timings = {"two-scale": 3.0, "stochastic": 1.0}
    return assemble(
        scene, *studies.values(), facts=RunFacts(case=CASE, surface=SURFACE, timings=timings)
    )


@pytest.fixture(scope="module")
def page(results):
    return report_html(results)


def parsed(page):
    assert page.startswith("<!DOCTYPE html>\n")
    return ElementTree.fromstring(page.split("\n", 1)[1])


def words(element):
    return " ".join("".join(element.itertext()).split())


def section(page, name):
    (found,) = (s for s in parsed(page).iter("section") if s.get("id") == name)
    return found


def pictures(page):
    return list(parsed(page).iter("img"))


def body_rows(table):
    return [
        [words(cell) for cell in row.findall("td")] for row in table.iter("tr") if row.findall("td")
    ]


# --- the page stands by itself ----------------------------------------------------------------------------


def test_texts_of_the_case_are_escaped(page):
    root = parsed(page)
    assert words(root.find(".//h1")) == CASE["title"]
    assert "Face_A.x3p" in words(section(page, "values"))


def test_the_page_stands_by_itself(page):
    """Every section is there and reached, and nothing is loaded from elsewhere."""
    root = parsed(page)
    assert [s.get("id") for s in root.iter("section")] == SECTIONS
    links = [a.get("href") for a in root.find(".//nav").iter("a")]
    assert links == [f"#{name}" for name in SECTIONS]
    ids = [e.get("id") for e in root.iter() if e.get("id")]
    assert len(ids) == len(set(ids))
    texts = [p.get("alt") for p in pictures(page)]
    assert len(texts) == len(set(texts)) >= 5
    for element in root.iter():
        for name in {"src", "href", "srcset", "action", "data", "poster"} & {*element.attrib}:
            assert element.get(name).startswith(("data:image/png;base64,", "#"))
    assert not {"link", "iframe", "object", "embed"} & {e.tag for e in root.iter()}
    policy = next(m.get("content") for m in root.iter("meta") if m.get("http-equiv"))
    assert policy == "default-src 'none'; img-src data:; style-src 'unsafe-inline'"
    assert "<script" not in page
    assert len(page.encode()) < 4e6
    assert "url(" not in page
    assert "http" not in page.replace("http-equiv", "")


def test_the_same_results_give_the_same_page(results, page, tmp_path):
    assert report_html(results) == page
    save(results, tmp_path)
    assert write_report(tmp_path) == tmp_path / "report.html"
    assert (tmp_path / "report.html").read_text(encoding="utf-8") == page


# --- what it says -----------------------------------------------------------------------------------------


def test_table_has_the_numbers_of_the_dataset(results, page):
    (table,) = (t for t in section(page, "numbers").iter("table") if t.get("id") == "leakage-table")
    heads = [words(h) for h in table.find("thead").iter("th")]
    rows = body_rows(table)
    factor, unit = leakage_unit(results.leakage)
    assert unit in words(section(page, "numbers").find("p[@id='leakage-unit']"))
    data = results.dataset
    for head in ("median", "two-scale", "deterministic"):
        shown = [row[heads.index(head)] for row in rows]
        values = [0.0 if text == "sealed" else float(text) * factor for text in shown]
        assert_allclose(values, data[f"leakage_{head.replace('-', '_')}"].values, rtol=6e-3)
    column = heads.index("scatter between seals, 5–95 %")
    shown = np.array([row[column].split("–") for row in rows if "–" in row[column]], float).T
    ends = np.array([data["leakage_lower"], data["leakage_upper"]])
    assert_allclose(shown * factor, ends[:, ends[0] > 0], rtol=6e-3)


def test_drop_of_pressure_by_hand(results):
    """All pressure drops in the second third of the face, half of it in two cells."""
    data = results.dataset.copy(deep=True)
    rows = data.sizes["block1"]
    drop = np.clip(2 - 3 * (np.arange(rows) + 0.5) / rows, 0, 1)
    data["face_fluid_pressure"][:] = drop[:, None] * 1e6
    data["cell_drop_fraction"][:] = 0.5 / 16
    data["cell_drop_fraction"][:, 1, 2:4] = 0.25
    text = words(section(report_html(replace(results, dataset=data)), "maps"))
    assert "Half of the pressure drops in 2 of 18 cells." in text


def test_times_and_warnings(scene, studies):
    """Parts of a study are not counted twice."""
    timings = {
        "two-scale: contact of the whole face": 3.0,
        "two-scale: cells of the face": 1.0,
        "two-scale": 6.0,
        "stochastic": 2.0,
    }
    facts = RunFacts(case=CASE, timings=timings, warnings=("cell <b>3</b> failed", "cell 4 failed"))
    page = report_html(assemble(scene, studies["two_scale"], facts=facts))
    rows = body_rows(section(page, "time").find("table"))
    assert [(name, share) for name, _, share in rows] == [
        ("two-scale", "75 %"),
        ("stochastic", "25 %"),
    ]
    listed = [words(item) for item in section(page, "warnings").iter("li")]
    assert listed[-2:] == ["cell <b>3</b> failed", "cell 4 failed"]


def test_a_part_of_a_run_may_have_any_name(scene, studies):
    timings = {"blocks: all": 3.0, "blocks: all: contact": 2.0}
    facts = RunFacts(timings=timings, attributes={"timed_parts": json.dumps(["blocks: all"])})
    page = report_html(assemble(scene, studies["two_scale"], facts=facts))
    rows = body_rows(section(page, "time").find("table"))
    assert [(name, share) for name, _, share in rows] == [("blocks: all", "100 %")]


@pytest.mark.parametrize(
    ("method", "without"),
    [("deterministic", {"cells"}), ("two_scale", set()), ("stochastic", set())],
)
def test_every_method_alone_has_the_sections_that_it_fills(scene, studies, method, without):
    page = report_html(assemble(scene, studies[method]))
    sections = [name for name in SECTIONS if name not in without]
    assert [s.get("id") for s in parsed(page).iter("section")] == sections
    assert ("realisation nearest to the median" in words(section(page, "maps"))) == (
        method == "stochastic"
    )


@pytest.mark.parametrize(("value", "text"), [(0.0, "sealed"), (np.nan, "failed")])
def test_closed_and_failed_seals_are_told(results, value, text):
    data = results.dataset.copy(deep=True)
    for name in data.data_vars:
        if name.startswith(("leakage", "cell_k", "flux", "state_k")):
            data[name][:] = value
    data["cell_drop_fraction"][:] = np.nan
    page = report_html(replace(results, dataset=data))
    assert text in words(section(page, "numbers"))
    assert value != 0 or "nothing flows" in words(section(page, "maps"))


# --- files and command line -------------------------------------------------------------------------------


def test_bad_paths_are_refused_before_anything_is_drawn(results, tmp_path):
    with pytest.raises(InputError, match="the results have no folder"):
        write_report(results)
    for path in (tmp_path, tmp_path / "no" / "folder.html"):
        with pytest.raises(InputError, match="can be written"):
            write_report(results, path)
    with pytest.raises(InputError, match="results folder"):
        write_report(tmp_path)
    assert not list(tmp_path.iterdir())


# --- in a browser -----------------------------------------------------------------------------------------


@pytest.mark.skipif(BROWSER is None, reason="no Chromium on this machine to look at the page with")
def test_the_page_is_printed(page, tmp_path):
    source, target = tmp_path / "page.html", tmp_path / "page.pdf"
    source.write_text(page, encoding="utf-8")
    flags = ["--headless", "--no-sandbox", "--disable-gpu", "--no-pdf-header-footer"]
    command = [BROWSER, *flags, f"--print-to-pdf={target}", str(source)]
    subprocess.run(command, check=True, capture_output=True, timeout=600)
    content = target.read_bytes()
    assert content.startswith(b"%PDF")
    assert 2 <= len(re.findall(rb"/Type\s*/Page\b", content)) <= 8


def test_the_patch_that_leaks_most_has_a_picture_and_a_caption(tmp_path):
    faces = [
        self_affine((24, 32), (30e-6, 40e-6), hurst=0.8, rms_slope=0.15, roll_off=30e-6, rng=n)
        for n in (1, 2)
    ]
    scene = steel_scene(Patches(faces), loading=(5e7, 2e8))
    results = assemble(scene, deterministic(scene))
    page = write_report(results, tmp_path / "report.html").read_text()
    attributes = results.dataset["patch_height"].attrs
    text = f"Heights of measured patch {attributes['patch']} of 2"
    assert text in page
    assert f"{attributes['over_mean']:.3g} times the mean of all patches" in page
