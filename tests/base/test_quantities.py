"""Quantities as text: units in, SI out, and everything ambiguous refused."""

import pytest
from numpy.testing import assert_allclose

import femseal as fs
from femseal.base import InputError, to_si, to_text
from femseal.base.quantities import absolute_pressure

ATMOSPHERE, PSI = 101_325.0, 6894.757293168361


@pytest.mark.parametrize(
    ("text", "unit", "value"),
    [
        ("210 GPa", "Pa", 210e9),
        ("500MPa", "Pa", 500e6),
        ("1.5 mm", "m", 1.5e-3),
        ("3 kPa", "Pa", 3e3),
        ("5 nm", "m", 5e-9),
        (".5 µm", "m", 0.5e-6),
        ("62.5 um", "m", 62.5e-6),
        ("3e-3 m", "m", 3e-3),
        ("-2 bar", "Pa", -2e5),
        ("1 mPa*s", "Pa*s", 1e-3),
        ("1 mPa.s", "Pa*s", 1e-3),
        ("870 kg/m^3", "kg/m^3", 870.0),
        ("0.87 g/cm^3", "kg/m^3", 870.0),
        ("210000 N/mm2", "Pa", 210e9),
        ("210000 N/mm²", "Pa", 210e9),
        ("1 N/(mm^2)", "Pa", 1e6),
        ("1000 kgf/cm2", "Pa", 98066500.0),
        ("3 atm", "Pa", 303975.0),
        ("1 mPas", "Pa*s", 1e-3),
        ("1 mPa·s", "Pa*s", 1e-3),
        ("870 kg/m3", "kg/m^3", 870.0),
        ("870 kg m-3", "kg/m^3", 870.0),
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
        ("-273.15 °C", "K", 0.0),
        ("-459.67 °F", "K", 0.0),
        ("2 mil", "m", 50.8e-6),
        ("1 mils", "m", 25.4e-6),
        ("1 micron", "m", 1e-6),
        ("32 µin", "m", 0.8128e-6),
        ("5 mil/in", "", 5e-3),
        ("760 Torr", "Pa", 101325.0),
        ("1 mTorr", "Pa", 101.325 / 760),
        ("30 ksi", "Pa", 30e3 * PSI),
        ("150 psi", "Pa", 150 * PSI),
        ("30 Msi", "Pa", 30e6 * PSI),
        ("10 mmWS", "Pa", 98.0665),
        ("2 kp/mm2", "Pa", 2 * 9.80665e6),
        ("0.3", "", 0.3),
        ("30 percent", "", 0.3),
        ("30 %", "", 0.3),
        (0.3, "", 0.3),
        (3, "", 3.0),
    ],
)
def test_texts_with_units_are_converted_to_si(text, unit, value):
    assert_allclose(to_si(text, unit), value, rtol=1e-12)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("1,5 Pa", "expected a number with a decimal point and no comma"),
        ("1,500 Pa", "no comma"),
        ("0,3", "no comma"),
        ("1.000,5 bar", "no comma"),
        ("10 MPA", "capitals count: MPa or mPa$"),
        ("10 BAR", "capitals count: bar$"),
        ("280 HV", "such as '10 MPa'$"),
        ("5 MPas", "expected"),
        ("5 mm", "a number and a unit of the kind 'Pa', such as '10 MPa'$"),
        ("5 kg/cm2", "kg/cm2 is of another kind, perhaps meant: kgf/cm2$"),
        ("5 lb/in2", "lb/in2 is of another kind, perhaps meant: lbf/in2$"),
        ("5 micron", "micron is of another kind, perhaps meant: mTorr$"),
    ],
)
def test_a_similar_unit_is_suggested(text, said):
    with pytest.raises(InputError, match=rf"^load: given .*{said}"):
        to_si(text, "Pa", "load")


@pytest.mark.parametrize(
    ("text", "kelvin"),
    [
        ("32 °F", 273.15),
        ("212 °F", 373.15),
        ("0 °C", 273.15),
        ("0.1 °C", 273.25),
        ("80 °C", 353.15),
    ],
)
def test_temperatures_are_exact_to_the_last_digit(text, kelvin):
    assert to_si(text, "K") == kelvin


@pytest.mark.parametrize(
    "text", ["-300 °C", "-273.2 degC", "-1 K", "-500 °F", "-459.7 fahrenheit", "-1 mK", "-1 °R"]
)
def test_no_temperature_is_below_absolute_zero(text):
    with pytest.raises(InputError, match=r"^seal: given .*not below absolute zero, -273\.15 °C"):
        to_si(text, "K", "seal")


@pytest.mark.parametrize(
    ("given", "unit"),
    [
        (210e9, "Pa"),  # a bare number
        ("210", "Pa"),
        (True, ""),
        (None, "m"),
        ("", "m"),
        (".", ""),
        ("1 mm", "Pa"),  # another dimension
        ("1 mm", ""),
        ("20 °C", "Pa"),
        ("16 degree_Reaumur", "K"),  # a zero of its own
        ("2.0.0 °C", "K"),
        ("nan Pa", "Pa"),
        ("1e999 Pa", "Pa"),
        (float("nan"), ""),
        (float("inf"), ""),
        (10**400, ""),
        ("one metre", "m"),
        ("1 2 m", "m"),
    ],
)
def test_texts_that_are_no_quantity_are_refused(given, unit):
    with pytest.raises(InputError, match=r"^width: given .*, expected "):
        to_si(given, unit, "width")


#: Among them what the parser of units would run, or take for ever to read.
NO_UNITS = ("(", "'''", "m\\", "m (", "m * ", "[m]", "m; m", "m\x00", "m\nm", "**", "m**999999999", "m^m", "((m))",
            "millimeter kilo", "lambda: m", "__import__('os')", "m.__class__", "m[0]", "m:m", "m**2**2", "None",
            "a b c d e f g", "m" * 1000, "(" * 1000, "m*" * 500 + "m")  # fmt: skip


@pytest.mark.parametrize("unit", NO_UNITS)
def test_text_that_is_no_unit_is_refused(unit):
    with pytest.raises(InputError, match=r"^width: given .*, expected ") as error:
        to_si(f"1 {unit}", "m", "width")
    assert len(str(error.value)) < 300


@pytest.mark.parametrize(
    ("value", "unit", "text"),
    [
        (999.9999999999999e6, "Pa", "1 GPa"),
        (1e-15, "m", "0.001 pm"),
        (-2e5, "Pa", "-200 kPa"),
        (0.0, "m", "0 m"),
    ],
)
def test_values_are_written_with_a_readable_prefix(value, unit, text):
    assert to_text(value, unit) == text


@pytest.mark.parametrize("value", [2.5e9, 1.25e-6, 3.0, -4e-3])
def test_written_values_are_read_back(value):
    assert_allclose(to_si(to_text(value, "m"), "m"), value, rtol=1e-12)


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("10 bar(g)", 1e6 + ATMOSPHERE),
        ("10 bar (g)", 1e6 + ATMOSPHERE),
        ("10barg", 1e6 + ATMOSPHERE),
        ("10 bar g", 1e6 + ATMOSPHERE),
        ("10 barG", 1e6 + ATMOSPHERE),
        ("10 bar(ü)", 1e6 + ATMOSPHERE),
        ("150 psi(g)", 150 * PSI + ATMOSPHERE),
        ("150 psig", 150 * PSI + ATMOSPHERE),
        ("3 kPag", 3e3 + ATMOSPHERE),
        ("-0.5 bar(g)", ATMOSPHERE - 5e4),
        ("0 bar(g)", ATMOSPHERE),
        ("2 atm(g)", 3 * ATMOSPHERE),
        ("10 bar(a)", 1e6),
        ("10 bara", 1e6),
        ("150 psia", 150 * PSI),
        ("0 bar(a)", 0.0),
    ],
)
def test_what_a_pressure_is_counted_from(text, value):
    assert_allclose(absolute_pressure(text, ATMOSPHERE), value, rtol=1e-12)
    with pytest.raises(
        fs.InputError, match=r"^load: given .*, expected a pressure without \(g\) or \(a\)"
    ):
        to_si(text, "Pa", "load")


@pytest.mark.parametrize(
    "text",
    [
        "10 bar",
        "10 Pa",
        "1 psi",
        "3 mmHg",
        "10 g",
        "10 bar*g",
        "10 kg",
        10.0,
        None,
        "",
        "(g)" * 100,
    ],
)
def test_what_says_neither(text):
    assert absolute_pressure(text, ATMOSPHERE) is None


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (
            "-2 bar(g)",
            r"given '-2 bar\(g\)', expected a pressure of at least -101.3 kPa, the pressure of a vacuum",
        ),
        ("-1 bar(a)", "expected a pressure of at least 0 Pa, the pressure of a vacuum"),
        ("1,5 bar(g)", r"given '1,5 bar\(g\)', expected a number with a decimal point"),
        ("10 bar(g)(a)", "without"),
        ("10 mm(g)", "of the kind 'Pa'"),
        ("barg", "of the kind 'Pa'"),
        ("10 (g)", "of the kind 'Pa'"),
    ],
)
def test_refused(text, said):
    with pytest.raises(fs.InputError, match=said):
        absolute_pressure(text, ATMOSPHERE, "fluid.inlet_pressure")
