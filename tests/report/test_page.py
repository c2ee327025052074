"""The report: one page that stands by itself, says what the dataset says, and can be read everywhere."""

import base64
import json
import re
import shutil
import subprocess
import sys
from dataclasses import replace
from xml.etree import ElementTree

import matplotlib.image
import numpy as np
import pytest
from numpy.testing import assert_allclose
from small_cases import soft_cycle

import femseal as fs
from femseal import cli
from femseal.base.errors import InputError
from femseal.base.leak_rates import leakage_unit
from femseal.report import write_folder, write_report
from femseal.report.case_text import pressure_drop_sentences
from femseal.report.page import report_html
from femseal.results import RunFacts, assemble, save
from femseal.studies import Sampling
from femseal.studies.drawn_study import stochastic
from femseal.studies.face_study import deterministic
from femseal.studies.piece_study import two_scale

pytestmark = pytest.mark.usefixtures("drawn_pictures")

SECTIONS = [
    "leakage",
    "maps",
    "drop",
    "pieces",
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
def quick(scene, studies):
    """Results with a page of one picture."""
    timings = {"deterministic": 3.0, "writing": 1.0}
    return assemble(scene, studies["deterministic"], facts=RunFacts(case=CASE, timings=timings))


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


def test_every_section_is_there_and_reached(page):
    root = parsed(page)
    assert [s.get("id") for s in root.iter("section")] == SECTIONS
    assert [a.get("href") for a in root.find(".//nav").iter("a")] == [
        f"#{name}" for name in SECTIONS
    ]
    assert root.get("lang") == "en"
    assert "width=device-width" in next(
        m.get("content") for m in root.iter("meta") if m.get("name") == "viewport"
    )
    assert "@media print" in page
    ids = [e.get("id") for e in root.iter() if e.get("id")]
    assert len(ids) == len(set(ids))


def test_nothing_is_loaded_from_elsewhere(page):
    root = parsed(page)
    for element in root.iter():
        for name, value in element.attrib.items():
            if name in ("src", "href", "srcset", "action", "data", "poster"):
                assert value.startswith(("data:image/png;base64,", "#")), value[:60]
    assert not {"link", "iframe", "object", "embed"} & {e.tag for e in root.iter()}
    policy = next(m.get("content") for m in root.iter("meta") if m.get("http-equiv"))
    assert policy == "default-src 'none'; img-src data:; style-src 'unsafe-inline'"
    assert "<script" not in page
    assert len(page.encode()) < 4e6
    assert "url(" not in page
    assert "http" not in re.sub(r"http-equiv", "", page)
    for picture in pictures(page):
        assert base64.b64decode(picture.get("src").split(",")[1]).startswith(b"\x89PNG")


def test_every_picture_says_what_it_shows(page):
    texts = [p.get("alt") for p in pictures(page)]
    assert (
        len(texts) == len(set(texts)) == 9
    )  # face, leakage, two of pieces, three maps, drawn seal, drop
    assert all(len(text) > 40 for text in texts)


def test_texts_of_the_case_are_escaped(page):
    root = parsed(page)
    assert words(root.find(".//h1")) == CASE["title"]
    assert "Face_A.x3p" in words(section(page, "case"))


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
    assert len(rows) == data.sizes["step"]
    for head, name in (
        ("median", "leakage_median"),
        ("two-scale", "leakage_two_scale"),
        ("deterministic", "leakage_deterministic"),
    ):
        shown = [row[heads.index(head)] for row in rows]
        values = [0.0 if text == "sealed" else float(text) * factor for text in shown]
        assert_allclose(values, data[name].values, rtol=6e-3)
    column = heads.index("redraws of the measured patch, 5–95 %")
    low, high = (
        np.array([row[column].split("–") for row in rows if "–" in row[column]], float).T * factor
    )
    leaking = data["leakage_lower"].values > 0
    assert_allclose(low, data["leakage_lower"].values[leaking], rtol=6e-3)
    assert_allclose(high, data["leakage_upper"].values[leaking], rtol=6e-3)


def test_first_numbers_are_those_of_first_and_highest_load(results, page):
    keys = {
        words(d.find("dt")): words(d.find("dd"))
        for d in parsed(page).find(".//header//dl").findall("div")
    }
    for s in (0, 2, 4):
        text = keys[f"whole seal, {results.steps[s].name}"]
        if text == "sealed":
            assert results.leakage[s] == 0
            continue
        # each in a unit of its own
        number, unit = text.split(" ")
        assert_allclose(float(number), results.leakage_in(unit)[s], rtol=6e-3)
    assert_allclose(
        float(keys["in contact at the highest load"].rstrip(" %")),
        100 * results.dataset["contact_fraction"][2],
        rtol=6e-3,
    )


def test_resolution_is_told(page):
    text = words(section(page, "errors"))
    assert "8 pixels" in text  # 8 µm waves on pixels of 1 µm
    assert "25 %" in text  # slope 0.2 before, 0.15 after
    assert "imbalance" not in text


def test_leakage_comes_before_the_classes(scene, studies):
    page = report_html(assemble(scene, studies["stochastic"], facts=RunFacts(classes=["L0.01"])))
    head = words(parsed(page).find(".//header"))
    assert 0 < head.index("whole seal, loading") < head.index("Leakage classes")


def test_drop_of_pressure_by_hand(results):
    """All pressure drops in the second third of the face, half of it in two pieces."""
    data = results.dataset.copy(deep=True)
    rows = data.sizes["block1"]
    data["face_fluid_pressure"][:] = (
        np.clip(2 - 3 * (np.arange(rows) + 0.5) / rows, 0, 1)[:, None] * 1e6
    )
    data["piece_drop_fraction"][:] = 0.5 / 16
    data["piece_drop_fraction"][:, 1, 2:4] = 0.25
    text = " ".join(pressure_drop_sentences(replace(results, dataset=data)))
    assert "Half of the pressure drops in 2 of 18 pieces." in text


def test_times_warnings_and_versions(quick):
    page = report_html(quick)
    rows = body_rows(section(page, "time").find("table"))
    assert rows == [["deterministic", "3 s", "75 %"], ["writing", "1 s", "25 %"]]
    assert "None" in words(section(page, "warnings"))
    assert fs.__version__ in words(section(page, "versions"))
    failed = quick.dataset.copy()
    failed.attrs["warnings"] = json.dumps(["cell <b>3</b> failed", "cell 4 failed"])
    page = report_html(replace(quick, dataset=failed))
    assert [words(item) for item in section(page, "warnings").iter("li")] == [
        "cell <b>3</b> failed",
        "cell 4 failed",
    ]
    assert "2 warnings" in words(parsed(page).find(".//header"))


def test_parts_of_a_study_are_not_counted_twice(scene, studies):
    timings = {
        "two-scale: contact of the whole face": 3.0,
        "two-scale: pieces of the face": 1.0,
        "two-scale": 6.0,
        "stochastic": 2.0,
    }
    told = assemble(scene, studies["two_scale"], facts=RunFacts(case=CASE, timings=timings))
    rows = body_rows(section(report_html(told), "time").find("table"))
    assert [(name, share) for name, _, share in rows] == [
        ("two-scale", "75 %"),
        ("stochastic", "25 %"),
    ]


def test_repairs_of_measured_faces_are_told(scene, studies):
    second = {"kind": "file", "path": "B.plu"}
    case = CASE | {"face": [*CASE["face"], second]}
    surface = SURFACE | {"undefined_fraction": 0.0114, "spike_points": 8}
    told = assemble(scene, studies["deterministic"], facts=RunFacts(case=case, surface=surface))
    text = words(section(report_html(told), "case"))
    assert "against a measured face from B.plu" in text
    assert "1.1 % undefined points and 8 points in spikes were filled" in text


@pytest.mark.parametrize("method", ["deterministic", "two_scale", "stochastic"])
def test_every_method_alone_has_all_sections(scene, studies, method):
    page = report_html(assemble(scene, studies[method]))
    assert [s.get("id") for s in parsed(page).iter("section")] == SECTIONS
    assert len(pictures(page)) == {"deterministic": 6, "two_scale": 8, "stochastic": 5}[method]
    assert ("drawn seal" in words(section(page, "maps"))) == (method == "stochastic")


def test_closed_and_failed_seals_are_told(results):
    data = results.dataset.copy(deep=True)
    for name in data.data_vars:
        if name.startswith(("leakage", "piece_k", "flux", "state_k")):
            data[name][:] = 0.0
    data["piece_drop_fraction"][:] = np.nan
    page = report_html(replace(results, dataset=data))
    assert "nothing flows" in words(section(page, "drop"))
    assert "sealed" in words(section(page, "numbers"))
    data = results.dataset.copy(deep=True)
    for name in data.data_vars:
        if name.startswith(("leakage", "realisation_spread", "flux", "fluid_pressure")):
            data[name][-1 if "realisation" in data[name].dims else slice(None)] = np.nan
    assert "failed" in words(section(report_html(replace(results, dataset=data)), "numbers"))


# --- files and command line -------------------------------------------------------------------------------


def test_results_write_their_own_page(quick, tmp_path):
    page = quick.report(tmp_path / "page.html")
    assert page.read_text(encoding="utf-8") == report_html(quick)


def test_it_is_one_of_the_files_of_a_run(quick, tmp_path):
    written = write_folder(quick, tmp_path)
    assert tmp_path / "report.html" in written
    assert "report.html" in (tmp_path / "files.txt").read_text().split()
    assert (tmp_path / "report.html").read_text(encoding="utf-8") == report_html(quick)


def test_bad_paths_are_refused_before_anything_is_drawn(results, tmp_path):
    with pytest.raises(InputError, match="without a folder"):
        write_report(results)
    for path in (tmp_path, tmp_path / "no" / "folder.html"):
        with pytest.raises(InputError, match="can be written"):
            write_report(results, path)
    with pytest.raises(InputError, match="results folder"):
        write_report(tmp_path)
    assert not list(tmp_path.iterdir())


def test_command_line(quick, tmp_path, monkeypatch, capsys):
    save(quick, tmp_path)
    page = report_html(quick)
    for arguments, target in (
        ([], tmp_path / "report.html"),
        (["-o", str(tmp_path / "page.html")], tmp_path / "page.html"),
    ):
        monkeypatch.setattr(sys, "argv", ["femseal", "report", str(tmp_path), *arguments])
        cli.main()
        assert capsys.readouterr().out.strip() == str(target)
        assert target.read_text(encoding="utf-8") == page
    monkeypatch.setattr(sys, "argv", ["femseal", "report", str(tmp_path / "none")])
    with pytest.raises(SystemExit) as stop:
        cli.main()
    assert stop.value.code == 2


# --- in a browser -----------------------------------------------------------------------------------------


def browse(*arguments):
    flags = ["--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars"]
    subprocess.run(
        [BROWSER, *flags, *map(str, arguments)], check=True, capture_output=True, timeout=600
    )


@pytest.mark.skipif(BROWSER is None, reason="no Chromium on this machine to look at the page with")
class TestBrowser:
    @pytest.mark.parametrize("width", [390, 1200])
    def test_nothing_reaches_beyond_the_page(self, page, width, tmp_path):
        """The right margin stays empty from top to bottom, and the page is not."""
        (tmp_path / "page.html").write_text(page, encoding="utf-8")
        style = f"width:{width}px;height:6000px;border:0"
        (tmp_path / "frame.html").write_text(
            f'<body style="margin:0"><iframe src="page.html" style="{style}"></iframe>'
        )
        browse(
            f"--window-size={max(width, 600)},6000",
            f"--screenshot={tmp_path / 'page.png'}",
            tmp_path / "frame.html",
        )
        image = matplotlib.image.imread(tmp_path / "page.png")[:, :width, :3]
        assert (image[:, -8:] > 0.99).all()
        assert (image < 0.9).any(axis=2).mean() > 0.02
        lines = (image < 0.9).any(axis=(1, 2))
        assert lines.nonzero()[0].max() > 2500  # long, and drawn to its end

    def test_print(self, page, tmp_path):
        (tmp_path / "page.html").write_text(page, encoding="utf-8")
        browse(
            "--no-pdf-header-footer",
            f"--print-to-pdf={tmp_path / 'page.pdf'}",
            tmp_path / "page.html",
        )
        content = (tmp_path / "page.pdf").read_bytes()
        assert content.startswith(b"%PDF")
        assert 2 <= len(re.findall(rb"/Type\s*/Page\b", content)) <= 8
