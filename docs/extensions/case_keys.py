"""The page of all keys of a case file, from the tables of `femseal.case` and the comments of its template."""

import json
import re
from pathlib import Path
from typing import Literal, get_args, get_origin

from pydantic_core import PydanticUndefined

import femseal
from femseal.base.quantities import to_text
from femseal.case.case import Case
from femseal.case.faults import INTERNAL
from femseal.case.schema import case_schema
from femseal.case.values import Quantity, Table

_HEAD = """# All keys of a case file

A quantity is text with any unit of its kind: `"0.2 mm"` where the column *unit* has m. The column *needed* says when a
key must stand in the file, *since* the first version that has it. A key without a default is off, or its meaning says
how it is chosen. `femseal schema` writes the same for editors. [Case files](case.md) shows the template and explains
groups of keys.
"""
_COLUMNS = "| key | type | unit | default | needed | since | meaning |\n|---|---|---|---|---|---|---|"
_TEMPLATE = Path(femseal.__file__).with_name("case") / "template.toml"
#: When a key is needed, where the tables of the file do not say it.
_NEEDED = {
    ("face", "kind"): "yes, without a `path` or `places`",
    ("face", "path"): '`"file"`: this or `places`',
    ("face", "places"): '`"file"`: this or `path`',
    ("face", "rms_slope"): '`"self-affine"`: this or `rms_height`',
    ("face", "rms_height"): '`"self-affine"`: this or `rms_slope`',
    ("face", "mirror"): "no; of a second face",
    ("face", "rotate"): "no; of a second face",
    ("face", "shift"): "no; of a second face",
    ("material", "young"): "yes, without a `name`",
    ("load", "unloading"): "with `unload_from`",
    ("fluid", "kind"): "yes, without a `name`",
    ("fluid", "viscosity"): "yes, without a `name`",
    ("fluid", "molar_mass"): '`"ideal-gas"` without a `name`',
    ("fluid", "temperature"): '`"ideal-gas"` without a `name`',
    ("fluid", "inlet_pressure"): "yes, unless the inlets of a mesh have pressures",
    ("cells", "count"): "no; in place of `size`",
    ("cells", "size"): "no; in place of `count`",
    ("load.map", "length_unit"): '`"field"`',
}
#: Meaning of keys that the template shows without a comment, or with one that only its own line explains.
_MEANING = {
    ("", "title"): "Heading of the report",
    ("face", "kind"): "How the heights are made or read",
    ("face", "points"): "Points along x1 and x2",
    ("face", "size"): "Length along x1 and x2; of a file only where the file has none, or a wrong one",
    ("face", "hurst"): "Hurst exponent, of a turned face that of its roughness",
    ("face", "rms_slope"): "Root mean square of the slope",
    ("face", "rms_height"): "Root mean square of the height",
    ("face", "feed_error"): "Rms scatter of the feed, as a fraction of the pitch",
    ("face", "depth_error"): "Rms scatter of the depth, as a fraction of the depth",
    ("face", "waviness_length"): "Wave length of that wave",
    ("face", "roughness_roll_off"): "End of the plateau of the spectrum of the roughness",
    ("face", "path"): "File of an instrument, relative to the case",
    (
        "face",
        "places",
    ): "[Several measured places](tutorials/places.md) of one face",
    ("face", "spacing"): "Size of a pixel along x1 and x2, in place of `size`",
    ("face", "height_unit"): "Unit of the heights, where the file has none, or a wrong one",
    ("face", "array"): "Name of the heights in an `.npz`",
    ("face", "channel"): "Number or name of the channel, where the file has several",
    ("face", "periodic"): "Whether the heights repeat along x1 and x2",
    ("face", "mirror"): "Axis along which it is reversed",
    ("face", "rotate"): "Angle by which it lies on the first face",
    ("face", "shift"): "Shift of its middle along x1 and x2",
    ("material", "young"): "Young's modulus",
    ("material", "poisson"): "Poisson's ratio",
    ("material", "yield_stress"): "Hardness is 2.8 times that; without this and `hardness` the solid is elastic",
    ("material", "hardness"): "Largest contact pressure",
    ("material", "nix_gao_depth"): "Depth h* of a hardness that falls with depth by Nix and Gao",
    ("material", "smallest_depth"): "Depth up to which that hardness is constant",
    (
        "material",
        "hardness_table",
    ): "Hardness over the depth to which a point has yielded",
    (
        "material",
        "name",
    ): "A [metal](case.md#metals-by-their-name): modulus, ratio and strength",
    ("load", "loading"): "Loads in assembly, rising",
    ("load", "unload_from"): "Peaks from which the seal is unloaded",
    ("load", "unloading"): "Loads on the way down from each peak",
    ("load", "relaxation"): "Fraction of each load that is lost between assembly and service",
    ("load", "map"): "[Shape of the contact pressure](tutorials/bolts.md) over the seal",
    ("flow", "solver"): "Of the pressure in cells and over the seal",
    ("fluid", "kind"): "Law of density and viscosity",
    ("fluid", "viscosity"): 'Dynamic, or kinematic such as `"46 cSt"` beside a density',
    ("fluid", "density"): 'At the reference state; 870 kg/m³ unless given of `"roelands-liquid"`',
    ("fluid", "pressure_viscosity"): "Rise of viscosity with pressure: by Barus, or by Roelands",
    (
        "fluid",
        "surface_tension",
    ): "With a contact angle above 90°, gives the pressure below which the liquid enters no gap",
    ("fluid", "contact_angle"): "On the faces; above 90° they are not wetted",
    ("fluid", "inlet_pressure"): 'Of a gas absolute, or gauge such as `"99 bar(g)"`',
    ("fluid", "outlet_pressure"): "As the inlet pressure",
    ("fluid", "name"): "A [fluid by its name](case.md#fluids-by-their-name), which fills in the keys of its kind",
    ("fluid", "molar_mass"): "Of the gas",
    ("fluid", "temperature"): "Of the gas",
    ("seal", "kind"): "Shape of the seal",
    ("seal", "lay"): 'Direction of x2 of the face on the seal; `{kind = "spiral"}` winds the grooves of a turned face',
    ("seal", "inner_radius"): "Of the ring",
    ("seal", "outer_radius"): "Of the ring",
    (
        "seal",
        "inlet",
    ): "Side of the ring or boundaries of the mesh for the fluid; a table gives pressures",
    ("seal", "path"): "File of the mesh, relative to the case",
    ("seal", "unit"): "Unit of the lengths in the mesh",
    ("seal", "outlet"): "Boundaries where the fluid leaves; all others are closed",
    ("seal", "centre"): 'Of a lay `"circumferential"` or `"radial"`',
    ("seal", "length"): "Length that the leakage is divided by; that of the outlet unless given",
    ("seal", "form"): "[Form of the whole seal](case.md#form-of-the-whole-seal), which gives each tile its pressure",
    ("seal.form", "kind"): "Waves, or heights of a file",
    ("seal.form", "height"): "From crest to trough",
    ("seal.form", "lobes"): "Waves once around",
    ("seal.form", "wavelength"): "In place of `lobes`, on a strip or a ring",
    ("seal.form", "path"): "A text with the columns x, y, z or r, theta, z, or a map of heights",
    ("seal.form", "unit"): "Of the heights; of a map that of the file unless given",
    ("seal.form", "length_unit"): "Of x and y or r",
    ("seal.form", "tolerance"): "Relative error of the height, for the budget",
    ("seat", "kind"): "Form of the seat, added to the roughness",
    ("seat", "radius"): "Of the crown or ball",
    ("seat", "angle"): "Half the angle of the cone; loads are then axial",
    ("seat", "land"): "Breadth of the flat part",
    ("seat", "edge_radius"): "Of both edges",
    ("seat", "tilt"): "Slope across the seal, highest at the inlet",
    ("seat", "path"): "File with the columns x1 and z",
    ("seat", "unit"): "Of its lengths",
    ("cells", "count"): "Pieces along x1 and x2; unless given as many as suit the drawn seals, and for two scales "
    "eight shortest waves or more a side",
    ("cells", "size"): "Side of a piece, about",
    ("stochastic", "length"): "Of a straight seal, along x2; the face unless given",
    ("stochastic", "realisations"): "Seals that are drawn; as many as the band of error needs unless given",
    ("stochastic", "quantiles"): "Ends of the band between seals",
    ("output", "paraview"): "Files for any ParaView, or none",
    ("output", "report"): "The page `report.html`; `femseal report DIR` makes it later",
    ("output", "test_fluid"): "Keys of `[fluid]`: fluid of a leak test on the same seals, which decides on the classes",
    ("output", "model_parts"): "Sources of the budget that are of the model and its input",
    ("load.map", "kind"): "How the pressure varies over the seal",
    ("load.map", "at"): "Load at which the map holds, where there are several",
    ("load.map", "fractions"): "Pressures over their mean, in strips or at the positions or angles",
    ("load.map", "positions"): "Places of the fractions across the seal, on a ring radii",
    ("load.map", "angles"): "Places of the fractions around the seal",
    ("load.map", "repeat"): "Times that the fractions repeat around the seal",
    ("load.map", "path"): "A mesh with the pressure at points or cells, or a `.csv`",
    ("load.map", "name"): "Of the array, or of the column",
    ("load.map", "length_unit"): "Of the coordinates",
    ("load.map", "pressure_unit"): "Of the pressures",
}
#: Keys and whole tables that version 0.1 does not have.
_SINCE_0_2 = {
    *(("", "seat"), ("contact", "fluid_pressure"), ("face", "places"), ("load.map", "fractions"), ("load", "nominal")),
    *(("load", "relaxation"), ("output", "model_parts"), ("surface", "continue_spectrum"), ("seal", "form")),
    *(("seal", "flatness"), ("seal.form", "tolerance")),
    *(("fluid", key) for key in ("ambient_pressure", "bulk_modulus", "slip_length")),
    *(("material", key) for key in ("name", "hardening", "hardness_table", "hardness_tolerance")),
    *(("material", key) for key in ("nix_gao_depth", "smallest_depth")),
}
#: Those that version 0.2 does not have.
_SINCE_0_3 = {("face", "tip_radius"), ("face", "resolution")}
_NUMBER_KINDS = {"string": "text", "number": "number", "integer": "whole number", "boolean": "true or false"}


def write_case_keys(page: Path) -> None:
    """Write the page: one section for a table of the file, one row for a key."""
    said, definitions = _comments() | _MEANING, case_schema()["definitions"]
    top = {name: field for name, field in Case.model_fields.items() if name not in INTERNAL}
    plain = {name: field for name, field in top.items() if not _tables(field.annotation)}
    root = case_schema()["properties"]
    blocks = [_HEAD, "## Top of the file", _COLUMNS]
    blocks += [_row(("", name), field, root[name], "", said) for name, field in plain.items()]
    for name, field in top.items():
        if name == "counter_material":
            blocks += [
                "\n## [counter_material]\n",
                "The keys of `[material]`. Without it the counter-face is rigid.",
            ]
        elif tables := _tables(field.annotation):
            needed = "must stand in the file" if field.is_required() else "may be left out"
            blocks += [f"\n## [{name}]\n\nThis table {needed}.\n", _COLUMNS, *_rows(name, tables, definitions, said)]
    maps = _tables(Case.model_fields["load"].annotation.model_fields["map"].annotation)
    blocks += ["\n## load.map\n\nOne table, or a list of several with `at`.\n", _COLUMNS]
    blocks += _rows("load.map", maps, definitions, said)
    forms = _tables(_tables(Case.model_fields["seal"].annotation)[0].model_fields["form"].annotation)
    blocks += ["\n## seal.form\n\nOne table, or a list of several, which add up.\n", _COLUMNS]
    blocks += _rows("seal.form", forms, definitions, said)
    page.write_text("\n".join(blocks) + "\n", encoding="utf-8")


def _rows(section, tables, definitions, said):
    """Rows of all keys of the tables of a section; where there are several kinds, the kinds that a key belongs to."""
    keys = {}
    for table in tables:
        for name, field in table.model_fields.items():
            keys.setdefault(name, []).append((table, field))
    kinds = {
        table: get_args(table.model_fields["kind"].annotation)[0] for table in tables if "kind" in table.model_fields
    }
    if len(tables) > 1:
        names = ", ".join(f'`"{kind}"`' for kind in kinds.values())
        default = tables[0].model_fields["kind"].default
        needed = _NEEDED.get((section, "kind"), "yes")
        since = "0.2" if ("", section) in _SINCE_0_2 else "0.1"
        yield f"| `kind` | one of {names} | | {_shown(default, None)} | {needed} | {since} | {said[section, 'kind']} |"
        keys.pop("kind")
    for name, found in keys.items():
        table, field = found[0]
        where = "" if len(found) == len(tables) else ", ".join(f'`"{kinds[t]}"`' for t, _ in found)
        needed = [t for t, f in found if f.is_required()]
        if where and needed:
            where = ", ".join(f'`"{kinds[t]}"`' + ("" if t in needed else " (may be left out)") for t, _ in found)
        elif needed and len(needed) < len(found):
            where = ", ".join(f'`"{kinds[t]}"`' for t in needed)
        schema = definitions[table.__name__]["properties"].get(name, {})
        yield _row((section, name), field, schema, where if needed or not where else f"no; of {where}", said)


def _row(key, field, schema, where, said):
    quantity = _quantity(field.annotation, field.metadata)
    default = "" if field.is_required() else _shown(field.default, quantity)
    needed = _NEEDED.get(key) or where or ("yes" if field.is_required() else "no")
    unit = "" if quantity is None else quantity.unit.replace("*", "·").replace("^3", "³")
    since = "0.2" if {key, ("", key[0])} & _SINCE_0_2 else "0.1"
    since = "0.3" if key in _SINCE_0_3 else since
    meaning = said.get(key, "").replace("|", r"\|")
    return " | ".join([f"| `{key[1]}`", _type(schema, quantity), unit, default, needed, since, meaning, ""]).strip()


def _type(schema, quantity):
    """Kind of a value in words, with its example."""
    if "$ref" in str(schema):
        return "table, or list of tables" if schema.get("type") == "array" else "table"
    if schema.get("type") == ["string", "array"]:
        return "text, or list of texts or tables"
    if schema.get("type") == "array":
        items, length = schema.get("items", {}), schema.get("maxItems")
        return f"list of {length or 'several'}: {_type(items, quantity)}"
    if options := schema.get("enum"):
        return "one of " + ", ".join(f"`{json.dumps(o)}`" for o in options)
    if "anyOf" in schema and "description" not in schema:
        return " or ".join(dict.fromkeys(_type(option, quantity) for option in schema["anyOf"]))
    if quantity is not None:
        return re.sub(r"'([^']*)'", r"`\1`", quantity.expected)
    if said := schema.get("description"):
        return re.sub(r"'([^']*)'", r"`\1`", said)
    if "const" in schema:
        return f'`"{schema["const"]}"`'
    kinds = schema.get("type", "text")
    return " or ".join(_NUMBER_KINDS.get(k, k) for k in ([kinds] if isinstance(kinds, str) else kinds))


def _shown(default, quantity):
    """A default as a file would give it."""
    if default is None or default is PydanticUndefined or default == ():
        return ""
    if isinstance(default, bool):
        return f"`{str(default).lower()}`"
    if isinstance(default, (int, float)):
        unit = "" if quantity is None else quantity.unit
        text = to_text(default, unit).replace("byte", "B") if unit != "kg/m^3" else f"{default:g} {unit}"
        return f"`{text}`" if unit else f"`{default:g}`"
    if isinstance(default, (tuple, list)):
        return f"`{json.dumps(default)}`"
    return "" if default == "" else f'`"{default}"`'


def _quantity(annotation, metadata=()):
    """The quantity that an annotation contains, or None, also where it contains several of different units."""
    found = [*metadata, *_parts(annotation)]
    quantities = [part for part in found if isinstance(part, Quantity)]
    return quantities[0] if len({q.unit for q in quantities}) == 1 else None


def _parts(annotation):
    for part in get_args(annotation):
        yield part
        yield from _parts(part)


def _tables(annotation):
    """Tables of a case file that an annotation contains."""
    if isinstance(annotation, type) and issubclass(annotation, Table):
        return [annotation]
    if get_origin(annotation) is Literal:
        return []
    return list(dict.fromkeys(table for inner in get_args(annotation) for table in _tables(inner)))


def _comments():
    """What the template says of a key, by the name of its table and its own."""
    said, section, last = {}, "", None
    for line in _TEMPLATE.read_text(encoding="utf-8").splitlines():
        if header := re.match(r"#? ?\[+(\w+)\]+", line):
            section, last = header[1], None
        elif (found := re.match(r"#? ?(\w+) = (.*)$", line)) and (split := re.match(r"(.*?\S)\s+# (.*)$", found[2])):
            last = (section, found[1])
            said.setdefault(last, split[2])
        elif (more := re.match(r"#? {20,}#? ?(.*)$", line)) and last is not None:
            said[last] += " " + more[1]
        else:
            last = None
    return {key: text[0].upper() + text[1:] for key, text in said.items()}
