"""The route from a drawing: its case and its script run, and its rules give the Ra, Rz and slopes that they say."""

import re
import runpy
from pathlib import Path

import numpy as np
import pytest
from code_on_pages import code_blocks, merged_case
from numpy.testing import assert_allclose

import femseal as fs
from femseal.case import Case, case_template

PAGE = Path(__file__).parents[2] / "docs" / "drawing.md"
RZ, PITCH = 3.2e-6, 60e-6


def test_the_case_of_the_page_has_the_roughness_of_its_title(tmp_path):
    (tmp_path / "seal.toml").write_text(
        merged_case(case_template(Case), *code_blocks(PAGE, "toml")), encoding="utf-8"
    )
    case = fs.load_case(tmp_path / "seal.toml")
    face = case.face[0]
    given = {
        name: getattr(face, name) for name in ("pitch", "depth", "roughness", "roughness_roll_off")
    }
    assert_allclose(list(given.values()), [PITCH, 0.7 * RZ, 0.1 * RZ, 0.6 * PITCH])
    made = fs.turned(
        face.points,
        face.size,
        **given,
        feed_error=face.feed_error,
        depth_error=face.depth_error,
        rng=1,
    )
    report = fs.describe_surface(made)
    assert report.rz[0] == pytest.approx(RZ, rel=0.1)
    assert 4 < report.rz[0] / report.ra[0] < 5.5


def test_arcs_of_a_tool_have_the_closed_forms_of_their_height_and_slope():
    """Before filters: z = R_z (2x/f)², by the mean, the square and the slope of a parabola."""
    z = RZ * np.linspace(-1, 1, 100_001) ** 2
    ra, rq = np.abs(z - z.mean()).mean(), z.std()
    slope = np.sqrt(np.mean(np.gradient(z, PITCH / 100_000) ** 2))
    assert_allclose(
        [ra / RZ, rq / RZ, slope * PITCH / RZ], [4 / 9 / 3**0.5, 2 / 45**0.5, 4 / 3**0.5], rtol=1e-3
    )
    text = PAGE.read_text(encoding="utf-8")
    said = re.search(r"Ra = ([\d.]+) Rz, Rq = ([\d.]+) Rz, .* the grooves is ([\d.]+) Rz/f", text)
    assert_allclose(
        [float(n) for n in said.groups()], [ra / RZ, rq / RZ, slope * PITCH / RZ], rtol=0.02
    )


def test_faces_of_one_ra_leak_by_their_slope(tmp_path, capsys):
    (tmp_path / "slope.py").write_text(code_blocks(PAGE, "python")[0], encoding="utf-8")
    runpy.run_path(str(tmp_path / "slope.py"))
    found = [float(n) for n in re.findall(r"\d[\d.]*(?:e-\d+)?", capsys.readouterr().out)]
    (ra, steep, k), (other, flat, less) = np.reshape(found, (2, 3))
    assert_allclose([ra, other], 0.1, atol=0.021)
    assert steep > 2 * flat
    assert k / less == pytest.approx(50, rel=0.1)
