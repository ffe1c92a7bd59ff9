"""Logins by a provider (OpenID Connect): the code flow with PKCE. Knows neither routes nor the database.

Three requests: the provider describes itself (discovery), gives tokens for the code that the browser brought, and tells
more of the person. What it signed is checked against its keys by ``joserfc``.
"""

from __future__ import annotations

import hashlib
import logging
import secrets
import time
from base64 import urlsafe_b64encode
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any
from urllib.parse import urlencode

import httpx
from joserfc import jwt
from joserfc.errors import JoseError
from joserfc.jwk import KeySet

from app.core.errors import LoginFailedError
from app.core.messages import say
from app.core.settings import Settings

KNOWN_FOR_S = 600.0
"""A provider changes its keys seldom, and tells both old and new for a while."""
TIMEOUT_S = 10.0
LEEWAY_S = 60
"""Clocks differ."""
ALGORITHMS = ["RS256", "RS384", "RS512", "PS256", "PS384", "PS512", "ES256", "ES384", "ES512", "EdDSA"]
"""Signatures by a key of the provider's own; none by a secret that a client shares."""

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class Attempt:
    """A login that has begun: what only this browser and this service know of it."""

    state: str
    nonce: str
    verifier: str

    @classmethod
    def new(cls) -> Attempt:
        """One that nobody can guess."""
        return cls(*(secrets.token_urlsafe(32) for _ in range(3)))


@contextmanager
def _understood() -> Iterator[None]:
    """Whatever goes wrong with the provider is one error for a person; the log has the cause."""
    try:
        yield
    except (httpx.HTTPError, JoseError, KeyError, ValueError, TypeError) as error:
        logger.warning("a login by the provider failed: %s: %s", type(error).__name__, error)
        raise LoginFailedError(say("access.who_is_it")) from error


class Provider:
    """The provider of logins that the settings name."""

    def __init__(self, settings: Settings) -> None:
        self._settings = settings
        self._known: tuple[float, dict[str, Any], KeySet] | None = None

    def address(self, attempt: Attempt, redirect_uri: str) -> str:
        """Where the browser is sent to log in; ``LoginFailedError`` where the provider does not answer."""
        with _understood():
            description, _ = self._description()
        challenge = (
            urlsafe_b64encode(hashlib.sha256(attempt.verifier.encode()).digest()).rstrip(b"=").decode()
        )
        query = {
            "response_type": "code",
            "client_id": self._settings.oidc_client_id,
            "redirect_uri": redirect_uri,
            "scope": self._settings.oidc_request,
            "state": attempt.state,
            "nonce": attempt.nonce,
            "code_challenge": challenge,
            "code_challenge_method": "S256",
        }
        joint = "&" if "?" in description["authorization_endpoint"] else "?"
        return f"{description['authorization_endpoint']}{joint}{urlencode(query)}"

    def claims(self, attempt: Attempt, code: str, redirect_uri: str) -> dict[str, Any]:
        """What the provider says of whoever logged in; ``LoginFailedError`` where it does not, or not credibly."""
        with _understood():
            return self._claims(attempt, code, redirect_uri)

    def _claims(self, attempt: Attempt, code: str, redirect_uri: str) -> dict[str, Any]:
        description, keys = self._description()
        secret = self._settings.oidc_client_secret
        assert secret is not None  # noqa: S101 - the settings see to it
        form = {
            "grant_type": "authorization_code",
            "code": code,
            "redirect_uri": redirect_uri,
            "code_verifier": attempt.verifier,
        }
        with httpx.Client(timeout=TIMEOUT_S) as client:
            auth = (str(self._settings.oidc_client_id), secret.get_secret_value())
            tokens = (
                client.post(description["token_endpoint"], data=form, auth=auth).raise_for_status().json()
            )
            claims = self._checked(tokens["id_token"], keys, description["issuer"], attempt.nonce)
            if (address := description.get("userinfo_endpoint")) and (token := tokens.get("access_token")):
                answer = client.get(address, headers={"Authorization": f"Bearer {token}"})
                more = answer.raise_for_status().json()
                if more.get("sub") != claims["sub"]:
                    raise ValueError("the provider tells of somebody else")
                claims = {**more, **claims}
        return claims

    def _checked(self, token: str, keys: KeySet, issuer: str, nonce: str) -> dict[str, Any]:
        claims = jwt.decode(token, keys, algorithms=ALGORITHMS).claims
        registry = jwt.JWTClaimsRegistry(
            leeway=LEEWAY_S,
            iss={"essential": True, "value": issuer},
            aud={"essential": True, "value": str(self._settings.oidc_client_id)},
            sub={"essential": True},
            exp={"essential": True},
            nonce={"essential": True, "value": nonce},
        )
        registry.validate(claims)
        return dict(claims)

    def _description(self) -> tuple[Mapping[str, Any], KeySet]:
        if self._known is None or self._known[0] < time.monotonic():
            issuer = str(self._settings.oidc_issuer)
            with httpx.Client(timeout=TIMEOUT_S) as client:
                address = f"{issuer}/.well-known/openid-configuration"
                description = client.get(address).raise_for_status().json()
                if str(description["issuer"]).rstrip("/") != issuer:
                    raise ValueError("the provider calls itself by another address than VERSANT_OIDC_ISSUER")
                keys = KeySet.import_key_set(client.get(description["jwks_uri"]).raise_for_status().json())
            self._known = (time.monotonic() + KNOWN_FOR_S, description, keys)
        return self._known[1], self._known[2]
