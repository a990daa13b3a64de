"""What an OpenAPI document describes, as values: the examples that a reader would try."""

import json
from collections.abc import Iterator, Mapping
from typing import Any

Schema = Mapping[str, Any]
_SAMPLES: dict[str, Any] = {"string": "...", "integer": 0, "number": 0.0, "boolean": True, "null": None}


def example(schema: Schema, schemas: Schema) -> Any:
    """A value that a schema describes, from its own examples where it has them."""
    for key in ("examples", "default", "enum"):
        if key in schema:
            return schema[key] if key == "default" else schema[key][0]
    if "$ref" in schema:
        return example(schemas[schema["$ref"].rpartition("/")[2]], schemas)
    if "anyOf" in schema:
        return example(schema["anyOf"][0], schemas)
    if "properties" in schema:
        return {name: example(field, schemas) for name, field in schema["properties"].items()}
    if "additionalProperties" in schema:
        return {example(schema["propertyNames"], schemas): example(schema["additionalProperties"], schemas)}
    return [example(schema["items"], schemas)] if "items" in schema else _SAMPLES[schema.get("type", "null")]


def requests(document: Schema, name: str) -> Iterator[tuple[str, str, str | None]]:
    """Method, path and body of a request to every route, in the document's order; of a drive of that name."""
    schemas = document["components"]["schemas"]
    for path, methods in document["paths"].items():
        for method, operation in methods.items():
            media = next(iter(operation.get("requestBody", {}).get("content", {}).values()), None)
            body = None if media is None else json.dumps(example(media["schema"], schemas))
            yield method, path.format(name=name, id="latest"), body
