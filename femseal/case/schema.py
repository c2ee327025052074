"""Make the JSON schema of case files, with which editors check and complete a case while it is written."""

from typing import Any

from pydantic.json_schema import GenerateJsonSchema

from .case import Case
from .faults import INTERNAL

#: Entries of pydantic's schema that are removed, because editors do not need them.
_LEFT_OUT = ("title", "discriminator", "start", "since", "instead", "needed")
_DRAFT = "http://json-schema.org/draft-07/schema#"


class _CaseSchema(GenerateJsonSchema):
    """Generate the schema of TOML files in draft 7 of JSON Schema, which editors support."""

    def default_schema(self, schema: Any) -> dict[str, Any]:
        """Leave defaults out, because they are numbers in SI units, whereas a case contains text with units."""
        return self.generate_inner(schema["schema"])

    def nullable_schema(self, schema: Any) -> dict[str, Any]:
        """Leave null out, because TOML has no null."""
        return self.generate_inner(schema["schema"])

    def tuple_schema(self, schema: Any) -> dict[str, Any]:
        """Describe a pair as a list, and allow a single table in place of a list of tables."""
        generated = super().tuple_schema(schema)
        if "prefixItems" in generated:  # a keyword that draft 7 does not have
            items = generated.pop("prefixItems")
            are_equal = all(item == items[0] for item in items)
            generated["items"] = items[0] if are_equal else {"anyOf": items}
        items = generated["items"]
        if "$ref" in items or "oneOf" in items:
            return {"anyOf": [items, generated]}
        return generated


def case_schema() -> dict[str, Any]:
    """Return the JSON schema of case files, with their tables, their keys and the types of their values.

    The schema contains neither the ranges of quantities nor the relations between keys, which only `load_case` checks.
    """
    schema = Case.model_json_schema(
        ref_template="#/definitions/{model}", schema_generator=_CaseSchema
    )
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
    """Remove the entries `_LEFT_OUT` from a schema and its parts, and add the possible values to each description."""
    if isinstance(node, list):
        return [_simplify(item) for item in node]
    if not isinstance(node, dict):
        return node
    simplified: dict[str, Any] = {}
    for word, value in node.items():
        if word in ("properties", "definitions"):
            # the keys inside are keys of the case, not keywords of the schema
            simplified[word] = {name: _simplify(inner) for name, inner in value.items()}
        elif word not in _LEFT_OUT:
            simplified[word] = _simplify(value)
    texts = dict.fromkeys([simplified.get("description"), simplified.pop("expected", None)])
    description = "; ".join(text for text in texts if text)
    return simplified | ({"description": description} if description else {})
