"""The API's documentation as one plain page, made from its OpenAPI schema: nothing is loaded from elsewhere."""

from html import escape
from typing import Any

STYLE = """
body{font:16px/1.5 system-ui,sans-serif;max-width:60rem;margin:2rem auto;padding:0 1rem;color-scheme:light dark}
code{font-size:.95em}h2{margin:2rem 0 .2rem;font-size:1.05rem}b{display:inline-block;min-width:4.5rem}
table{border-collapse:collapse}td{padding:.1rem 1rem .1rem 0;vertical-align:top}
"""


def page(schema: dict[str, Any]) -> str:
    """Return the page of an OpenAPI schema."""
    parts = [
        _operation(schema, method, path, op) for path, ops in schema["paths"].items() for method, op in ops.items()
    ]
    head = f"<!doctype html><html lang=en><meta charset=utf-8><title>snakeslam API</title><style>{STYLE}</style>"
    text = (
        "<h1>snakeslam API</h1><p>Send <code>Authorization: Bearer TOKEN</code>; errors are problem+json with one line "
        "in <code>detail</code>. The same in machine form: <a href=openapi.json>openapi.json</a>. "
        "<code>WS /api/v1/telemetry</code> streams state, ticks, events and camera frames; "
        "<code>WS /api/v1/teleop</code> takes drive input.</p>"
    )
    return head + text + "".join(parts)


def _operation(schema: dict[str, Any], method: str, path: str, operation: dict[str, Any]) -> str:
    title = f"<h2><b>{escape(method.upper())}</b> <code>{escape(path)}</code></h2>"
    fields = _fields(schema, operation)
    rows = "".join(f"<tr><td><code>{escape(name)}</code><td>{escape(text)}" for name, text in fields)
    return f"{title}<div>{escape(operation.get('description', ''))}</div>" + (f"<table>{rows}</table>" if rows else "")


def _fields(schema: dict[str, Any], operation: dict[str, Any]) -> list[tuple[str, str]]:
    """Return name and meaning of each parameter and each key of the body."""
    found = [(p["name"], f"in the {p['in']}: {_kind(p['schema'])}") for p in operation.get("parameters", [])]
    body = operation.get("requestBody", {}).get("content", {}).get("application/json", {}).get("schema", {})
    for part in (body, *body.get("anyOf", [])):
        name = part.get("$ref", "").rpartition("/")[2]
        model = schema.get("components", {}).get("schemas", {}).get(name, {})
        for key, value in model.get("properties", {}).items():
            need = ", required" if key in model.get("required", []) else ""
            found.append((key, f"{_kind(value)}{need}. {value.get('description', '')}".strip()))
    return found


def _kind(value: dict[str, Any]) -> str:
    """Return a schema's type in words."""
    if "anyOf" in value:
        return " or ".join(_kind(part) for part in value["anyOf"])
    if "enum" in value:
        return ", ".join(str(item) for item in value["enum"])
    signs = {"minimum": ">=", "maximum": "<=", "exclusiveMinimum": ">", "exclusiveMaximum": "<"}
    limits = [f"{sign} {value[key]:g}" for key, sign in signs.items() if key in value]
    return " ".join([str(value.get("type", "object")), *limits])
