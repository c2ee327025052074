"""Make the JSON schema of case files, with which editors check and complete a case while it is written."""

from typing import Any

from .case import Case
from .faults import INTERNAL

#: Entries of pydantic's schema that are removed. Editors do not need them; and the defaults are in SI units, not as
#: texts with units, as a case would state them.
_LEFT_OUT = ("title", "default", "discriminator", "start", "since", "instead", "needed")
_DRAFT = "http://json-schema.org/draft-07/schema#"


def case_schema() -> dict[str, Any]:
    """Return the JSON schema of case files, with their tables, their keys and the types of their values.

    The schema conforms to draft 7 of JSON Schema, which editors support. The schema contains neither the ranges of
    quantities nor the relations between keys, which only `load_case` checks.
    """
    schema = Case.model_json_schema(ref_template="#/definitions/{model}")
    schema["definitions"] = schema.pop("$defs")
    for name in INTERNAL:
        del schema["properties"][name]
    fluids = schema["properties"]["fluid"]["oneOf"]
    fluid_tables = [option["$ref"].rpartition("/")[2] for option in fluids]
    # In the tables of fluids and solids, no key is required, because a name can replace all other keys. In tables with
    # a default kind, no key is required either.
    for table in (*fluid_tables, "SolidTable", "FileFace", "RectangularLayoutTable"):
        del schema["definitions"][table]["required"]
    schema["definitions"]["CoatingTable"]["required"] = ["thickness"]
    output = schema["definitions"]["OutputTable"]
    for properties, key in ((schema["properties"], "fluid"), (output["properties"], "test_fluid")):
        properties[key] = {"anyOf": fluids}
    return {"$schema": _DRAFT} | _simplify(schema) | {"title": "femseal case"}


def _simplify(node: Any) -> Any:
    """Simplify a schema recursively.

    The value null is removed from the schema, because TOML has no null. Pairs are described as lists.
    """
    if isinstance(node, list):
        return [_simplify(item) for item in node]
    if not isinstance(node, dict):
        return node
    simplified: dict[str, Any] = {}
    for word, value in node.items():
        if word in ("properties", "definitions"):
            # the keys inside are names of the case, not words of the schema
            simplified[word] = {name: _simplify(inner) for name, inner in value.items()}
        elif word not in _LEFT_OUT:
            simplified[word] = _simplify(value)
    if "prefixItems" in simplified:
        simplified["items"] = _items_of_pair(simplified.pop("prefixItems"))
    if "anyOf" in simplified:
        simplified = _without_null(simplified)
    expected = simplified.pop("expected", None)
    simplified |= _description(simplified.get("description"), expected)
    items = simplified.get("items", {})
    if "$ref" in items or "oneOf" in items:
        # the user may write a single table instead of a list of tables
        description = _description(simplified.pop("description", None))
        return {"anyOf": [items, simplified]} | description
    return simplified


def _items_of_pair(items: list[Any]) -> Any:
    """Return the schema of the items of a list that represents a pair, because draft 7 does not have `prefixItems`."""
    are_equal = all(item == items[0] for item in items)
    return items[0] if are_equal else {"anyOf": items}


def _without_null(node: dict[str, Any]) -> dict[str, Any]:
    """Remove null from the alternatives of a schema; if a single alternative remains, merge it into the schema."""
    options = [option for option in node["anyOf"] if option != {"type": "null"}]
    others = {word: value for word, value in node.items() if word != "anyOf"}
    merged: dict[str, Any] = options[0] if len(options) == 1 else {"anyOf": options}
    description = _description(node.get("description"), merged.get("description"))
    return merged | others | description


def _description(*texts: str | None) -> dict[str, str]:
    """Join texts, such as the meaning of a key and its possible values, into a description without repetitions."""
    different = dict.fromkeys(text for text in texts if text)
    return {"description": "; ".join(different)} if different else {}
