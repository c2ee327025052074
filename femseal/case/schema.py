"""JSON schema of the case file, for editors that check and complete it while it is written."""

from typing import Any

from .case import Case
from .faults import INTERNAL


def case_schema() -> dict[str, Any]:
    """Schema (draft 7, which editors know) of a case file: its tables, keys and kinds of values.

    Rules between keys and ranges of quantities are not in the schema; `load_case` checks them.
    """
    schema = Case.model_json_schema(ref_template="#/definitions/{model}")
    schema["definitions"] = schema.pop("$defs")
    for name in INTERNAL:
        del schema["properties"][name]
    # what a name fills in need not be given, nor the kind of a face with a path or of a strip, nor pressures at inlets
    fluids = schema["properties"]["fluid"]["oneOf"]
    kinds = [option["$ref"].split("/")[-1] for option in fluids]
    for name in (*kinds, "SolidTable", "FileFace", "RectangularLayoutTable"):
        del schema["definitions"][name]["required"]
    tables = schema["properties"], schema["definitions"]["OutputTable"]["properties"]
    for table, key in zip(tables, ("fluid", "test_fluid"), strict=True):
        table[key] = {"anyOf": fluids}
    draft = {"$schema": "http://json-schema.org/draft-07/schema#"}
    return draft | _plain(schema) | {"title": "femseal case"}


def _plain(node: Any, names: bool = False) -> Any:
    """Schema as TOML has it: no null, pairs of one kind as lists, and neither titles nor defaults, which are in SI."""
    if isinstance(node, list):
        return [_plain(n) for n in node]
    if not isinstance(node, dict):
        return node
    if names:  # keys of a table may have the same names as words of the schema
        return {key: _plain(value) for key, value in node.items()}
    left_out = ("title", "default", "discriminator", "start", "since", "instead", "needed")
    tables = ("properties", "definitions")
    kept = {key: _plain(value, key in tables) for key, value in node.items() if key not in left_out}
    if "prefixItems" in kept:
        items = kept.pop("prefixItems")
        kept["items"] = items[0] if all(i == items[0] for i in items) else {"anyOf": items}
    if "anyOf" in kept:
        options = [o for o in kept.pop("anyOf") if o != {"type": "null"}]
        only = options[0] if len(options) == 1 else {"anyOf": options}
        kept = only | kept | _said(kept.get("description"), only.get("description"))
    kept |= _said(kept.get("description"), kept.pop("expected", None))
    items = kept.get("items", {})
    if "$ref" in items or "oneOf" in items:  # a single table needs no list
        kept = {"anyOf": [items, kept]} | _said(kept.pop("description", None))
    return kept


def _said(*texts: Any) -> dict[str, str]:
    """The description of a key: what it means, then what it may be."""
    said = dict.fromkeys(text for text in texts if text)
    return {"description": "; ".join(said)} if said else {}
