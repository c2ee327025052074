"""Write the page of all keys of a case file from the tables of `femseal.case`."""

import json
import re
from pathlib import Path

from femseal.base.leak_classes import KNOWN
from femseal.case.case import Case
from femseal.case.schema import case_schema
from femseal.case.template import (
    as_toml,
    case_template,
    choices,
    declared,
    keys_of,
    kind_of,
    quantity_of,
    summary,
    tables_in,
)

_HEAD = """# All keys of a case file

A quantity is a text with any unit of its kind, for example `"0.2 mm"` where the column *unit* contains m. The column
*needed, of kind* states when a key must be given, and for which kinds of the table it is valid. The column *since*
states the first version of femseal that accepts the key. If no default is stated, the column *meaning* may say how
femseal chooses the value; otherwise, the effect of the key is switched off unless you give the key. If a file contains
a key that has been removed, a message names its replacement.
`femseal schema` writes the same information for editors, and [Case files](case.md) explains how to use it.
"""
_COLUMNS = (
    "| key | type | unit | default | needed, of kind | since | meaning |\n" + 7 * "|---" + "|"
)
_KINDS = {"string": "text", "object": "table"}


def write_case_keys(page: Path, case=Case, schema=None) -> None:
    """Write the page, with a section for each table and a row for each key, and a template of a case beside it."""
    schema = schema or case_schema()
    fields, definitions = keys_of(case), schema["definitions"]
    blocks = [_HEAD, "## Top of the file\n", _COLUMNS]
    for name, field in fields.items():
        if not tables_in(field):
            blocks.append(
                _row(name, field, schema["properties"][name], _needed(name, field, fields), field)
            )
    seen = []
    for name, field in fields.items():
        blocks += _section(name, field, definitions, seen)
    page.write_text("\n".join(blocks) + "\n", encoding="utf-8")
    page.with_name("template.toml").write_text(case_template(case), encoding="utf-8")


def _section(name, field, definitions, seen):
    """Yield the lines of the section of a table, and of the sections of the tables inside it."""
    tables = tables_in(field)
    if not tables:
        return
    said = f"\n{_sentence(field.description)}.{' Needed.' if field.is_required() else ''}\n"
    yield f"\n## [{name}]\n{'' if '.' in name else said}"
    if tables[0] in seen:
        yield "Its keys are those of `[material]`."
        return
    seen += tables
    yield _COLUMNS
    found = {}
    for table in tables:
        for key, one in keys_of(table).items():
            found.setdefault(key, []).append((table, one))
    kinds = {table: f'`"{kind_of(table)}"`' for table in tables}
    if len(tables) > 1:
        meaning = "; ".join(f"{kinds[table]}: {summary(table)}" for table in tables)
        meaning = meaning.replace("|", r"\|")
        default = field.default["kind"] if isinstance(field.default, dict) else None
        when = "" if default else f"yes, {declared(field, 'needed') or ''}".removesuffix(", ")
        shown = f'`"{default}"`' if default else ""
        yield f"| `kind` | text | | {shown} | {when} | {declared(field, 'since')} | {meaning} |"
    for key, where in found.items():
        if key == "kind":
            continue
        table, one = where[0]
        of = "" if len(where) == len(tables) else ", ".join(kinds[table] for table, _ in where)
        required = [kinds[table] for table, each in where if each.is_required()]
        when = _needed(key, one, keys_of(table))
        if required and len(required) < len(where):
            when = f"yes, of {', '.join(required)}"
        meanings = list(dict.fromkeys(each.description for _, each in where))
        entry = definitions[table.__name__]["properties"].get(key, {})
        yield _row(key, one, entry, "; ".join(filter(None, [when, of])), field, "; ".join(meanings))
    for table in tables:
        for key, one in keys_of(table).items():
            if not one.examples and not set(tables_in(one)) & set(seen):
                yield from _section(f"{name}.{key}", one, definitions, seen)


def _needed(name, field, beside):
    """Return a phrase that says when a key must be given."""
    others = [f"or `{key}`" for key, one in beside.items() if declared(one, "instead") == name]
    when = [declared(field, "needed"), *others]
    if instead := declared(field, "instead"):
        when = [f"in place of `{instead}`"]
    return ", ".join(filter(None, ["yes" if field.is_required() else "", *when]))


def _row(name, field, schema, needed, around, meaning=""):
    quantity = quantity_of(field)
    default = "" if field.is_required() else _default(field, quantity)
    unit = "" if quantity is None else quantity.unit.replace("*", "·").replace("^3", "³")
    since = max(declared(field, "since"), declared(around, "since"))
    said = _sentence(meaning or field.description).replace("|", r"\|")
    cells = (
        f"`{name}`",
        _type(schema, quantity, field.description),
        unit,
        default,
        needed,
        since,
        said,
    )
    return f"| {' | '.join(cells)} |"


def _type(schema, quantity, meaning=""):
    """Describe the type of a value in words."""
    if "$ref" in str(schema):
        return "table, or list of tables" if "array" in str(schema) else "table"
    if schema.get("type") == ["string", "array"]:
        return "text, or list of texts or tables"
    if schema.get("type") == "array":
        items, length = schema.get("items", {}), schema.get("maxItems", "")
        return f"list{length and f' of {length}'}: {_type(items, quantity)}"
    if options := schema.get("enum"):
        return ", ".join(f"`{json.dumps(o)}`" for o in options)
    if "anyOf" in schema:
        return " or ".join(dict.fromkeys(_type(option, quantity) for option in schema["anyOf"]))
    said = schema.get("description", "").removeprefix(meaning or "").lstrip("; ")
    if said == KNOWN:
        return "[class](results.md#leakage-classes)"
    if said := said if quantity is None else quantity.expected:
        said = re.sub(r"^an? |, such as.*", "", said)
        if quantity is not None and quantity.unit:  # which says its kind
            said = re.sub(r"^[^<>]+(?=>)", "", said)
        return _code(said)
    kinds = schema.get("type", "text")
    return " or ".join(_KINDS.get(k, k) for k in ([kinds] if isinstance(kinds, str) else kinds))


def _default(field, quantity):
    """Return the default of a key as it would be written in a case file."""
    from femseal.base.quantities import to_text

    value = field.default
    if value is None or value == () or value == "":
        return ""
    if isinstance(value, tuple) and set(value) == {*choices(field)}:
        return "all"
    if quantity is None or not quantity.unit or isinstance(value, tuple):
        return f"`{as_toml(value)}`"
    text = to_text(value, quantity.unit).replace("byte", "B")
    return f"`{value:g} {quantity.unit}`" if "^" in quantity.unit else f"`{text}`"


def _code(text):
    return re.sub(r"'([^']*)'", r"`\1`", text)


def _sentence(text):
    return text[:1].upper() + text[1:]
