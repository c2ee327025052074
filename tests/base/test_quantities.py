"""Quantities as text: units in, SI out, and everything ambiguous refused."""

import pytest
from each import each
from numpy.testing import assert_allclose

from femseal.base import quantities
from femseal.base.errors import InputError
from femseal.base.quantities import to_si, to_text


@each(
    ("text", "unit", "value"),
    [
        ("210 GPa", "Pa", 210e9),
        ("500MPa", "Pa", 500e6),
        ("1.5 mm", "m", 1.5e-3),
        (".5 µm", "m", 0.5e-6),
        ("62.5 um", "m", 62.5e-6),
        ("3e-3 m", "m", 3e-3),
        ("-2 bar", "Pa", -2e5),
        ("1 mPa*s", "Pa*s", 1e-3),
        ("1 mPa.s", "Pa*s", 1e-3),
        ("870 kg/m^3", "kg/m^3", 870.0),
        ("0.87 g/cm^3", "kg/m^3", 870.0),
        ("29 g/mol", "kg/mol", 0.029),
        ("20 1/GPa", "1/Pa", 20e-9),
        ("300 K", "K", 300.0),
        ("20 °C", "K", 293.15),
        ("-10 degC", "K", 263.15),
        ("20 degree_Celsius", "K", 293.15),
        ("68 °F", "K", 293.15),
        ("-4 degF", "K", 253.15),
        ("212 Fahrenheit", "K", 373.15),
        ("540 °R", "K", 300.0),
        ("9 1/°F", "1/K", 16.2),
        ("0.3", "", 0.3),
        ("30 percent", "", 0.3),
        (0.3, "", 0.3),
        (3, "", 3.0),
    ],
)
def test_units(text, unit, value):
    assert_allclose(to_si(text, unit), value, rtol=1e-12)


@each("text", ["1,5 mm", "1,500 mm", "0,3"])
def test_decimal_comma_is_refused(text):
    with pytest.raises(InputError, match="expected a number with a decimal point, not a comma"):
        to_si(text, "m")


@each(
    ("text", "hint"),
    [
        ("1.000,5 bar", "comma: '1000.5 bar'$"),
        ("210,000 MPa", "'210.000 MPa', or '210000 MPa' without separators of thousands$"),
        ("10 MPA", "capitals count: MPa or mPa$"),
        ("10 BAR", "capitals count: bar$"),
        ("280 HV", "'280 HV' is about 2.75 GPa$"),
        ("280 HBW", "is about 2.75 GPa$"),
    ],
)
def test_what_may_have_been_meant(text, hint):
    with pytest.raises(InputError, match=hint):
        to_si(text, "Pa")


@each(
    ("given", "unit"),
    [
        (210e9, "Pa"),  # a bare number
        ("210", "Pa"),
        (True, ""),
        (None, "m"),
        ("", "m"),
        ("1 mm", "Pa"),  # another dimension
        ("1 mm", ""),
        ("20 °C", "Pa"),
        ("16 degree_Reaumur", "K"),  # a zero of its own
        ("2.0.0 °C", "K"),
        ("5 furlongz", "m"),
        ("nan Pa", "Pa"),
        ("inf Pa", "Pa"),
        ("1e999 Pa", "Pa"),
        (float("nan"), ""),
        (float("inf"), ""),
        ("one metre", "m"),
        ("1 2 m", "m"),
        ("__import__('os') m", "m"),
    ],
)
def test_refused(given, unit):
    with pytest.raises(InputError, match=r"^width: given .*, expected "):
        to_si(given, unit, "width")


def test_the_message_shows_what_would_do():
    with pytest.raises(InputError) as error:
        to_si("5 mm", "Pa", "solid.young", like="210 GPa")
    assert str(error.value) == (
        "solid.young: given '5 mm', expected text with a number and a unit of the kind 'Pa', such as '210 GPa'"
    )


@each("name", ["fluid.inlet_pressure", "assembly"])
def test_the_example_of_a_pressure_is_one(name):
    with pytest.raises(InputError, match="such as '10 MPa'"):
        to_si("10", "Pa", name)


@each(
    ("value", "unit", "text"),
    [
        (999.9999999999999e6, "Pa", "1 GPa"),
        (1e-15, "m", "0.001 pm"),
        (-2e5, "Pa", "-200 kPa"),
        (0.0, "m", "0 m"),
    ],
)
def test_text(value, unit, text):
    assert to_text(value, unit) == text


@each("value", [2.5e9, 1.25e-6, 3.0, -4e-3])
def test_text_is_read_back(value):
    assert_allclose(to_si(to_text(value, "m"), "m"), value, rtol=1e-12)


def test_long_lists_ask_the_parser_of_units_once(monkeypatch):
    registry, asked = quantities._registry(), []

    class Counting:
        def parse_units(self, text):
            asked.append(text)
            return registry.parse_units(text)

    quantities._factor.cache_clear()
    monkeypatch.setattr(quantities, "_registry", Counting)
    assert_allclose([to_si(f"{n} atm", "Pa") for n in (1, 2, 3)], [101325.0, 202650.0, 303975.0])
    assert asked == ["atm"]
    assert to_si("1 MPa", "Pa") == 1e6
    assert asked == ["atm"]


def test_usual_units_are_what_the_parser_of_units_says():
    for name, (unit, factor) in quantities._USUAL.items():
        assert_allclose(quantities._registry()(name).to(unit).magnitude, factor, rtol=1e-14)


def test_a_plain_number_is_asked_for_as_such():
    with pytest.raises(InputError, match=r"width: given '\.', expected a finite number$"):
        to_si(".", "", "width")
