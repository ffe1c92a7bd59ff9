"""What the API's document says of keys: how they are sent, and which operation needs which."""

from __future__ import annotations

from typing import Any

from app.access.rules import ROUTES, Rule
from app.core.http import problems

_SCHEMES = {
    "key": {"type": "http", "scheme": "bearer", "description": "A key: `Authorization: Bearer vsk_...`"},
    "password": {"type": "http", "scheme": "basic", "description": "Any user name, the key as password."},
    "session": {
        "type": "apiKey",
        "in": "cookie",
        "name": "__Host-versant",
        "description": "The cookie of a browser that logged in. By plain http its name is `versant-` and the port.",
    },
}
_SENTENCES = {
    Rule.MAP: "Without a key where the public map is live (VERSANT_PUBLIC_MAP), else with one of scope `own`.",
    Rule.LIVE: "Needs a key, of whatever scope.",
    Rule.UPLOAD: "Needs a key of scope `upload`, `own` or `operate`.",
    Rule.OWN: "Needs a key of scope `own` or `operate`.",
    Rule.OPERATE: "Needs a key of scope `operate`.",
}


def tell_rules(document: dict[str, Any]) -> None:
    """Add to each operation what it needs."""
    document["components"]["securitySchemes"] = _SCHEMES
    for path, operations in document["paths"].items():
        for method, operation in operations.items():
            rule = ROUTES.get((method.upper(), path), Rule.OPERATE)
            if rule is Rule.OPEN:
                continue
            keys: list[dict[str, list[str]]] = [{name: []} for name in _SCHEMES]
            operation["security"] = [{}, *keys] if rule is Rule.MAP else keys
            text = operation.get("description", "")
            operation["description"] = f"{text}\n\n{_SENTENCES[rule]}".strip()
            for status, answer in problems(401, 403).items():
                operation["responses"].setdefault(str(status), answer)
