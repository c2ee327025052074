"""Cases of a face by blocks: from the file to its band, what is refused, and the blocks that are taken by default."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from small_cases import TABLES

import femseal as fs
from femseal.case import load_case
from femseal.preparation import prepare
from femseal.runs.run_description import describe
from femseal.studies.block_division import usual_blocks

CASE = f"""
method = "blocks"
compare = ["deterministic"]
seed = 2
[face]
kind = "self-affine"
points = [128, 256]
size = ["120 um", "240 um"]
rms_slope = 0.2
roll_off = "20 um"
{TABLES}[contact]
fluid_pressure = "ignored"
[cells]
count = [8, 8]
"""


def load(folder, changed=CASE):
    path = folder / "blocks.toml"
    path.write_text(changed)
    return load_case(path)


def test_a_run_has_the_leakage_of_blocks_its_band_and_its_cells(tmp_path):
    one_load = CASE.replace('["100 MPa", "300 MPa"]', '["300 MPa"]')
    one_load = one_load.replace('unload_from = ["300 MPa"]\nunloading = ["100 MPa"]\n', "")
    case = load(tmp_path, one_load)
    results = fs.run(case, tmp_path / "out", workers=1)
    assert results.failures == []
    assert results.method == "blocks"
    alone = fs.by_blocks(prepare(case).scene, (2, 2))
    assert_array_equal(results.leakage, alone.leakage)
    budget = results.budget
    assert "blocks" in [part.name for part in budget.parts]
    assert (budget.lower < results.leakage).all()
    assert (budget.upper > results.leakage).all()
    assert_allclose(
        results.dataset["cell_pressure"].mean(("cell1", "cell2")),
        alone.steps.pressures,
        rtol=1e-3,
    )
    again = fs.open_results(tmp_path / "out")
    assert_array_equal(again.dataset["cell_k1"], alone.k1)
    assert_array_equal(again.dataset["leakage_blocks"], alone.leakage)
    assert "blocks" in (tmp_path / "out" / "report.html").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("old", "new", "text"),
    [
        ('"ignored"', '"trapped"', "fluid_pressure: given 'trapped' with blocks, expected 'acts'"),
        ("[8, 8]", "[8, 6]", r"cells: .*expected multiples of 4, the cells of a block"),
        (
            "[8, 8]",
            "[8, 12]",
            r"blocks: given 2 × 3 of 128 × 256 points, expected numbers of blocks whose",
        ),
    ],
)
def test_what_blocks_cannot_do_is_refused_before_anything_is_solved(tmp_path, old, new, text):
    with pytest.raises(fs.InputError, match=text):
        prepare(load(tmp_path, CASE.replace(old, new)))


def test_blocks_by_default_have_at_most_1024_points_a_side_and_take_the_memory_of_one(tmp_path):
    assert usual_blocks((1024, 1024)) == (2, 2)
    assert usual_blocks((4096, 3072)) == (4, 3)
    n1, n2 = 2400, 4104
    b1, b2 = usual_blocks((n1, n2))
    assert max(n1 / b1, n2 / b2) <= 1024
    assert n1 % (4 * b1) == n2 % (4 * b2) == 0
    made = prepare(
        load(tmp_path, CASE.replace("[128, 256]", "[512, 1024]").replace("[8, 8]", "[16, 16]"))
    )
    memory = {study.name: made.cost(study)[1] for study in made.studies}
    assert memory["blocks"] < memory["deterministic"] / 4
    text = "\n".join(describe(load(tmp_path), made))
    assert "4 × 4 blocks of 128 × 256 points" in text


@pytest.mark.slow
@pytest.mark.parametrize("line", ["", 'accuracy = "90 %"'])
def test_the_band_knows_pixels_also_where_half_the_points_are_no_blocks(tmp_path, line):
    alone = CASE.replace('compare = ["deterministic"]', line).replace("[128, 256]", "[136, 264]")
    results = fs.run(load(tmp_path, alone), workers=1)
    assert np.isfinite(results.budget.widths()["pixels"]).all()
