"""Pages of the HTTP interface, for a browser: nothing in them comes from anywhere else."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from html import escape
from typing import Any

from abbe.daemon.status.run_status import RunStatus
from abbe.daemon.status.text import lines

_EVERY = 2
"""s after which the status is loaded anew."""
_STYLE = """
body{font:15px/1.5 system-ui,sans-serif;max-width:60em;margin:1.5em auto;padding:0 1em;
color:#1f2933;background:#fff}
h1{font-size:1.4em}
h2{font-size:1.1em;margin:1.6em 0 .2em}
code,pre{font:13px/1.5 ui-monospace,monospace}
pre{white-space:pre-wrap;background:#f5f7fa;padding:1em;border-radius:6px}
table{border-collapse:collapse;margin:.4em 0 1em}
td{text-align:left;vertical-align:top;padding:.15em 1em .15em 0;border-bottom:1px solid #e4e7eb}
.state{display:inline-block;padding:.3em .8em;border-radius:6px;font-weight:600;background:#fde68a}
.good{background:#15803d;color:#fff}
.bad{background:#b91c1c;color:#fff}
.get{color:#1d4ed8}
.post{color:#c2410c}
small{color:#52606d}
"""


def _page(title: str, body: str, head: str = "") -> str:
    return (
        f'<!doctype html><html lang="en"><head><meta charset="utf-8">{head}'
        '<meta name="viewport" content="width=device-width">'
        f"<title>{escape(title)}</title><style>{_STYLE}</style></head><body>{body}</body></html>\n"
    )


def status_page(status: RunStatus) -> str:
    """A run in full; the browser loads it anew every two seconds."""
    _, *rest = lines(status)
    kind = "good" if status.in_full else "bad" if "NOT CORRECTED" in status.state else ""
    name = status.machine or "Abbe"
    body = (
        f'<h1>{escape(name)}</h1><p class="state {kind}">{escape(status.state)}</p>'
        f"<pre>{escape(chr(10).join(rest))}</pre>"
        f'<p><small>{status.at:%Y-%m-%d %H:%M:%S} · <a href="docs">what can be asked here</a> · '
        '<a href="metrics">metrics</a></small></p>'
    )
    refresh = f'<meta http-equiv="refresh" content="{_EVERY}">'
    return _page(f"{name}: {status.state}", body, refresh)


def api_page(schema: Mapping[str, Any]) -> str:
    """What can be asked, by its OpenAPI description."""
    info = schema["info"]
    parts = [
        f"<h1>{escape(info['title'])}</h1><p>{escape(info['description'])}</p>",
        '<p>For programs: <a href="api/openapi.json">OpenAPI</a>. With a token: '
        "<code>curl -H 'Authorization: Bearer TOKEN' …</code></p>",
    ]
    for path, methods in schema["paths"].items():
        for method, route in methods.items():
            parts.append(_route(path, method, route))
    parts.append("<h1>What comes back</h1>")
    for name, found in sorted(schema.get("components", {}).get("schemas", {}).items()):
        parts.append(_schema(name, found))
    return _page(info["title"], "".join(parts))


def _route(path: str, method: str, route: Mapping[str, Any]) -> str:
    parts = [
        f'<h2><code class="{method}">{method.upper()}</code> <code>{escape(path)}</code></h2>',
        f"<p>{escape(route.get('description', route.get('summary', '')))}</p>",
    ]
    rows = [
        (f"?{p['name']}", _kind(p["schema"]), p.get("description", ""))
        for p in route.get("parameters", ())
        if p["in"] == "query"
    ]
    body = route.get("requestBody", {}).get("content", {}).get("application/json", {})
    if body:
        rows.append(("body", _kind(body["schema"]), ""))
    for status, answer in route.get("responses", {}).items():
        kinds = ", ".join(
            _kind(content.get("schema", {})) or escape(kind)
            for kind, content in answer.get("content", {}).items()
        )
        rows.append((status, kinds, answer.get("description", "")))
    parts.append(_rows(rows))
    return "".join(parts)


def _schema(name: str, found: Mapping[str, Any]) -> str:
    rows = [
        (key, _kind(field), field.get("description", ""))
        for key, field in found.get("properties", {}).items()
    ]
    words = escape(found.get("description", ""))
    return f'<h2 id="{escape(name)}">{escape(name)}</h2><p>{words}</p>{_rows(rows)}'


def _rows(rows: list[tuple[str, str, str]]) -> str:
    """A table; the kinds are HTML already."""
    cells = (
        f"<tr><td><code>{escape(str(key))}</code></td><td>{kind}</td><td>{escape(words)}</td></tr>"
        for key, kind, words in rows
    )
    return f"<table>{''.join(cells)}</table>" if rows else ""


def _kind(schema: Mapping[str, Any]) -> str:
    """A type in a few words, as HTML."""
    return " or ".join(_kinds(schema))


def _kinds(schema: Mapping[str, Any]) -> Iterator[str]:
    if "$ref" in schema:
        name = escape(schema["$ref"].rpartition("/")[2])
        yield f'<a href="#{name}">{name}</a>'
    elif "anyOf" in schema:
        for part in schema["anyOf"]:
            yield from _kinds(part)
    elif "enum" in schema:
        yield ", ".join(escape(str(value)) for value in schema["enum"])
    elif schema.get("type") == "array":
        yield f"list of {_kind(schema.get('items', {})) or 'numbers'}"
    elif isinstance(schema.get("additionalProperties"), dict):
        yield f"name → {_kind(schema['additionalProperties'])}"
    elif "const" in schema:
        yield escape(str(schema["const"]))
    elif "type" in schema:
        yield escape(schema.get("format", schema["type"]))
