"""Cases that differ in their solids."""

from small_cases import HARDENED

from femseal.case import parse_case

YOUNG = {"young": "210 GPa"}
#: A case with two loads, whose material is replaced.
LOADED = HARDENED | {"load": {"loading": ["100 MPa", "500 MPa"]}}


def case_of_solids(material, counter=None, **tables):
    """Case with this material and, if given, this counter material; other tables take the place of its own."""
    counter_material = {"counter_material": counter} if counter else {}
    return parse_case(LOADED | {"material": material} | counter_material | tables)
