"""Properties that differ considerably from those of the named solid or fluid are warned of."""

import re

import pytest
from small_cases import CASE
from solids_in_cases import case_of_solids

import femseal as fs
from femseal.case import case_schema


def test_a_value_far_from_that_of_the_name_is_warned_of():
    odd = case_of_solids(
        {"name": "Inconel 718, aged", "hardness": "9 GPa"},
        {"name": "steel 1.4571, annealed", "young": "2.4 TPa"},
    )
    one, two = odd.named_warnings
    assert one.startswith("material.hardness 9 GPa is 2 times that of Inconel 718, aged, 4.44")
    assert two.startswith("counter_material.young 2400 GPa is 12 times that of steel")
    assert "named_warnings" not in {*odd.echo(), *case_schema()["properties"]}


NAMED = 'name = "helium"\ninlet_pressure = "1 MPa"\n'


@pytest.mark.parametrize(
    ("table", "said"),
    [
        ("", None),
        ('viscosity = "30 uPa*s"\n', None),
        ('viscosity = "1 mPa*s"\n', r"viscosity 1 mPa·s is 51 times that of helium, 19.62 µPa·s"),
        ('molar_mass = "1 g/mol"\n', r"molar_mass .* is 4 times less than that of helium"),
        ('kind = "liquid"\n', r"kind liquid is used for helium, which is of kind ideal-gas"),
    ],
)
def test_a_key_left_from_another_fluid_is_warned_of(tmp_path, table, said):
    """Of a test fluid too; it is no key of a case."""
    path = tmp_path / "case.toml"
    own = re.sub(r'kind = "liquid"\nvis.*\n.*\n', NAMED + table, CASE)
    for place, text in (
        ("fluid", own),
        ("output.test_fluid", f"{CASE}[output.test_fluid]\n{NAMED}{table}"),
    ):
        path.write_text(text)
        case = fs.load_case(path)
        warned = [re.search(rf"^{place}\.{said}", text) for text in case.named_warnings]
        assert [bool(found) for found in warned] == ([] if said is None else [True])
        assert "named_warnings" not in case.echo()
    path.write_text(f"named_warnings = []\n{CASE}")
    with pytest.raises(fs.InputError, match="named_warnings"):
        fs.load_case(path)
