"""The page at /docs: the REST interface, rendered from the service's own OpenAPI document.

No script and no outside address: a bench often has no network but its own. Knows nothing of the service.
"""

import json
from collections.abc import Iterator, Mapping
from html import escape
from typing import Any

Schema = Mapping[str, Any]

_STYLE = """
body { max-width: 1080px; }
header { padding: 18px 0 6px; }
header p { margin-top: 6px; }
header p, section > p, article p { max-width: 72ch; }
main { display: block; }
h1 small { color: var(--muted); font-weight: 400; }
h2 { margin: 28px 0 8px; }
h3 { font-size: 1rem; display: flex; flex-wrap: wrap; align-items: baseline; gap: 2px 12px; }
nav { margin-top: 12px; }
h4 { font-size: 0.85rem; margin: 14px 0 2px; color: var(--muted); font-weight: 600; }
nav ul { list-style: none; margin: 0; padding: 6px 0; }
nav li a { display: flex; flex-wrap: wrap; gap: 2px 12px; padding: 5px 14px; text-decoration: none; }
nav li a:hover { background: var(--quiet-bg); }
nav span { color: var(--muted); }
article { margin: 12px 0; padding: 14px 16px 16px; scroll-margin-top: 8px; }
article:target { border-color: var(--accent); }
code, pre { font-family: ui-monospace, "Cascadia Mono", "DejaVu Sans Mono", "Liberation Mono", monospace; }
code { font-size: 0.9em; overflow-wrap: anywhere; }
pre { margin: 4px 0 0; padding: 10px 12px; border-radius: 7px; background: var(--quiet-bg); overflow-x: auto;
  font-size: 0.85rem; line-height: 1.4; }
.method { display: inline-block; min-width: 3.2em; font: 600 0.85rem ui-monospace, "DejaVu Sans Mono", monospace;
  color: var(--accent); }
.method:is(.put, .post, .delete) { color: var(--warn); }
table { border-collapse: collapse; width: 100%; font-size: 0.93rem; }
td { padding: 4px 14px 4px 0; border-top: 1px solid var(--line); vertical-align: top; }
tr:first-child td { border-top: 0; }
td:first-child { width: 24%; white-space: nowrap; }
td:nth-child(2) { width: 30%; }
td:last-child { color: var(--muted); }
summary { cursor: pointer; color: var(--accent); margin-top: 12px; font-size: 0.9rem; }
"""


_KINDS = {"string": "text", "integer": "whole number", "boolean": "true or false"}
_SAMPLES: dict[str, Any] = {"string": "...", "integer": 0, "number": 0.0, "boolean": True, "null": None}


def render(document: Schema, root: str, name: str, *, with_token: bool = False) -> str:
    """The page for an OpenAPI document; `root`, the service's address, and a drive's `name` go into the commands."""
    info, schemas = document["info"], document["components"]["schemas"]
    operations = list(_operations(document))
    contents = "".join(
        f'<li><a href="#{_anchor(method, path)}">{_method(method)}<code>{escape(path)}</code>'
        f'<span>{escape(operation["summary"])}</span></a></li>'
        for method, path, operation in operations
    )
    articles = "".join(
        _article(method, path, operation, schemas,
                 _curl(method, root.rstrip("/") + path.format(name=name, id="latest"), operation, schemas,
                       ' -H "Authorization: Bearer $PMSM_BENCH_TOKEN"' if with_token else ""))
        for method, path, operation in operations
    )
    shapes = "".join(_shape(name, schema) for name, schema in sorted(schemas.items()))
    title = escape(info["title"])
    return (
        '<!doctype html><html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f'<title>{title} REST</title><link rel="icon" href="/favicon.ico"><link rel="stylesheet" href="/web/style.css">'
        f"<style>{_STYLE}</style></head><body><header><h1>{title} REST interface <small>{escape(info['version'])}"
        f'</small></h1><p>{escape(info["description"])}</p><p><a href="/">The operator\'s page</a> · '
        f'<a href="/openapi.json">OpenAPI document</a></p></header><main><nav class="card"><ul>{contents}</ul></nav>'
        f"<section><h2>Routes</h2>{articles}</section><section><h2>Shapes</h2>{shapes}</section></main></body></html>\n"
    )


def example(schema: Schema, schemas: Schema) -> Any:
    """A value that a schema describes, from its own examples where it has them."""
    for key in ("examples", "enum"):
        if key in schema:
            return schema[key][0]
    if "$ref" in schema:
        return example(schemas[_referred(schema)], schemas)
    if "anyOf" in schema:
        return example(schema["anyOf"][0], schemas)
    if "properties" in schema:
        return {name: example(field, schemas) for name, field in schema["properties"].items()}
    if "additionalProperties" in schema:
        return {example(schema["propertyNames"], schemas): example(schema["additionalProperties"], schemas)}
    return [example(schema["items"], schemas)] if "items" in schema else _SAMPLES[schema.get("type", "null")]


def _operations(document: Schema) -> Iterator[tuple[str, str, Schema]]:
    for path, methods in document["paths"].items():
        for method, operation in methods.items():
            yield method, path, operation


def _article(method: str, path: str, operation: Schema, schemas: Schema, command: str) -> str:
    parts = [
        f'<article class="card" id="{_anchor(method, path)}"><h3>{_method(method)}<code>{escape(path)}</code></h3>'
        f"<p>{escape(operation.get('description', operation['summary']))}</p>"
    ]
    if parameters := operation.get("parameters"):
        rows = ((p["name"], _type(p["schema"]), p.get("description", "")) for p in parameters)
        parts.append(f"<h4>Parameters</h4>{_rows(rows)}")
    if body := _content(operation.get("requestBody", {})):
        parts.append(f"<h4>Body: a JSON object, {_type(body)}</h4>{_fields(schemas[_referred(body)])}")
    parts.append(f"<h4>Try it</h4><pre>{escape(command)}</pre>")
    answers = sorted(operation["responses"].items())
    parts.append(f"<h4>Answers</h4>{_rows((code, _type(_content(a)), a['description']) for code, a in answers)}")
    if (schema := _content(_success(operation))).get("format") != "binary":
        text = json.dumps(example(schema, schemas), indent=2)
        parts.append(f"<details><summary>Example of an answer</summary><pre>{escape(text)}</pre></details>")
    return "".join([*parts, "</article>"])


def _curl(method: str, url: str, operation: Schema, schemas: Schema, token: str) -> str:
    answer, url = _success(operation)["content"], f"{url}{token}"
    if method != "get":
        body = _content(operation.get("requestBody", {}))
        data = f" -d '{json.dumps(example(body, schemas))}'" if body else ""
        media = "" if method == "delete" else " -H 'Content-Type: application/json'"
        return f"curl -X {method.upper()} {url}{media}{data}"
    if _content(_success(operation)).get("format") == "binary":
        *_, whose, _, name = url.partition(" ")[0].split("/")
        return f"curl -o {name if '.' in name else f'{whose[:-1]}.parquet'} {url}"
    return f"curl -N {url}" if "text/event-stream" in answer else f"curl {url}"


def _success(operation: Schema) -> Schema:
    """The answer of a request that is granted."""
    return next(answer for code, answer in operation["responses"].items() if code.startswith("2"))


def _shape(name: str, schema: Schema) -> str:
    return f'<article class="card" id="shape-{escape(name)}"><h3><code>{escape(name)}</code></h3>' \
        f"<p>{escape(schema.get('description', ''))}</p>{_fields(schema)}</article>"


def _fields(schema: Schema) -> str:
    fields = schema.get("properties", {}).items()
    return _rows((name, _type(field), field.get("description", "")) for name, field in fields)


def _rows(rows: Iterator[tuple[str, str, str]]) -> str:
    """A table of names, types (HTML) and descriptions."""
    cells = (f"<tr><td><code>{escape(a)}</code></td><td>{b}</td><td>{escape(c)}</td></tr>" for a, b, c in rows)
    return f"<table>{''.join(cells)}</table>"


def _type(schema: Schema) -> str:
    """What a schema takes, in words, as HTML."""
    if "$ref" in schema:
        name = escape(_referred(schema))
        return f'<a href="#shape-{name}">{name}</a>'
    if "anyOf" in schema:
        return " or ".join(_type(option) for option in schema["anyOf"])
    if words := schema.get("enum", [schema["const"]] if "const" in schema else []):
        return ", ".join(f"<code>{escape(str(word))}</code>" for word in words)
    if "items" in schema:
        return f"list of {_type(schema['items'])}"
    if isinstance(schema.get("additionalProperties"), dict):
        return f"{_type(schema['additionalProperties'])} by name"
    kind = "file" if schema.get("format") == "binary" else str(schema.get("type"))
    return "time (RFC 3339)" if schema.get("format") == "date-time" else escape(_KINDS.get(kind, kind))


def _content(part: Schema) -> Schema:
    """The schema of a request's or an answer's body, or of the events' data; empty where there is none."""
    for media in part.get("content", {}).values():
        return media["schema"] if "schema" in media else media["itemSchema"]["properties"]["data"]["contentSchema"]
    return {}


def _referred(schema: Schema) -> str:
    return schema["$ref"].rpartition("/")[2]


def _method(method: str) -> str:
    return f'<span class="method {escape(method)}">{escape(method.upper())}</span>'


def _anchor(method: str, path: str) -> str:
    return escape(f"{method}{path.replace('/', '-').replace('{', '').replace('}', '')}")
