"""The cases and scripts of the tutorials run, on small faces, and the page of keys explains every key."""

import re
import runpy
from functools import reduce
from pathlib import Path

import numpy as np
import pytest
import pyvista
from code_on_pages import code_blocks, merged_case, tables_of_case
from small_files import TURNED_CASE, write_map

import femseal as fs
from femseal.case import Case, case_template

ROOT = Path(__file__).parents[2]
PAGES = sorted((ROOT / "docs" / "tutorials").glob("*.md"))
PAGES.remove(ROOT / "docs" / "tutorials" / "index.md")
TEMPLATE = case_template(Case)
#: What makes a run of the small case quick.
QUICK = "budget = false\npictures = false\nfields = false\nparaview = 'none'\n"
SMALLER = [
    ("[512, 128]", "[256, 64]"),
    ("10 mm", "0.5 mm"),
    ("12 mm", "0.66 mm"),
    ("realisations = 10", "realisations = 3"),
]
LOADS = '[load]\nloading = ["50 MPa", "150 MPa"]\n'


RUN = {"measured_face", "places", "leak_test", "bolts", "flatness", "lens_ring"}
#: The page on coatings shows a part of a case that is shipped.
CASES = {
    page.stem: code_blocks(page, "toml")[0]
    for page in PAGES
    if code_blocks(page, "toml") and page.stem != "coating"
}


@pytest.fixture
def folder(tmp_path):
    """A folder with the maps that the pages name."""
    for n, name in enumerate("abc"):
        write_map(tmp_path / f"{name}.x3p", n)
    return tmp_path


def case_of(name, folder, text, loads="", output=""):
    """The case of a tutorial over that of a text, with small files, other loads and more keys of the output."""
    text = merged_case(text, CASES[name]).replace(".plu", ".x3p").replace("face.x3p", "a.x3p")
    if loads and name not in ("bolts", "flatness", "lens_ring"):
        text = merged_case(text, loads)
    if output:
        text = merged_case(
            text, f"[output]\n{output}{tables_of_case(CASES[name]).get('[output]', '')}"
        )
    (folder / "seal.toml").write_text(text, encoding="utf-8")
    return fs.load_case(folder / "seal.toml")


def test_the_case_of_every_tutorial_is_a_case(folder):
    assert set(CASES) == RUN
    for name in CASES:
        case_of(name, folder, TEMPLATE)


@pytest.mark.parametrize("name", sorted(RUN))
def test_the_case_of_a_tutorial_runs(name, folder, monkeypatch):
    smaller = reduce(lambda text, change: text.replace(*change), SMALLER, CASES[name])
    monkeypatch.setitem(CASES, name, smaller)
    method = "stochastic" if name in ("bolts", "flatness") else "deterministic"
    text = TURNED_CASE.replace("two-scale", method).replace("[128, 256]", "[64, 128]")
    results = fs.run(case_of(name, folder, text, LOADS, QUICK), folder / "results", workers=1)
    assert not results.failures
    first, *_, last = results.loading()[results.leakage.name].values
    assert last < first


def printed(block, folder, capsys, unit):
    """Numbers of a unit that a script of the page prints."""
    script = folder / "script.py"
    page = ROOT / "docs" / "tutorials" / "python.md"
    script.write_text(code_blocks(page, "python")[block], encoding="utf-8")
    runpy.run_path(str(script))
    return [float(n) for n in re.findall(rf"([\d.]+e-\d+) {unit}", capsys.readouterr().out)]


def test_an_array_of_heights_gives_a_curve_of_hysteresis(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    leakage = printed(0, tmp_path, capsys, "m²/s")
    loading, from_400, from_800 = leakage[:5], leakage[5:8], leakage[8:]
    assert loading == sorted(loading, reverse=True)
    for up, middle, low in zip(loading[2::-1], from_400, from_800, strict=True):
        assert up > middle > low > loading[4]
    assert Path("hysteresis.png").stat().st_size > 10_000


def test_a_mesh_gives_the_leakage_of_its_seals_and_a_file_for_paraview(
    tmp_path, capsys, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "meshes").symlink_to(ROOT / "meshes")
    first, second = printed(1, tmp_path, capsys, "m²/s")
    assert 0 < second < first
    picture = pyvista.read("seal.vtp")
    pressure = picture.cell_data["fluid_pressure_Pa"]
    assert 0 < pressure.min() < pressure.max() < 1e6
    # the area of the frame
    assert picture.area == pytest.approx(32e-3 * 24e-3 - 24e-3 * 16e-3, rel=1e-6)
    # pressure falls from the window to the rim
    x, y, _ = picture.cell_centers().points.T
    to_rim = np.maximum(abs(x) - 12e-3, abs(y) - 8e-3)
    assert np.corrcoef(to_rim, pressure)[0, 1] < -0.9


@pytest.mark.parametrize("block", [2, 3])
def test_the_form_gives_the_permeability_of_the_cell(tmp_path, capsys, block):
    # 64 × 128 elements of a smooth gap, and as many of a contact with closed pixels
    first, second = printed(block, tmp_path, capsys, "m³")
    assert abs(first / second - 1) < (1e-3 if block == 2 else 1e-2)


def test_the_page_of_keys_explains_every_key(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(ROOT / "docs" / "extensions")
    from case_keys import write_case_keys

    write_case_keys(tmp_path / "keys.md")
    text = (tmp_path / "keys.md").read_text("utf-8")
    rows = [line for line in text.splitlines() if line.startswith("| `")]
    assert len(rows) > 120
    assert [
        row
        for row in rows
        if len(cells := re.split(r"(?<!\\)\|", row)) != 9 or not cells[7].strip()
    ] == []
