"""Requests to the service by QGIS's own network layer: its proxy, its certificates, its stored logins."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any
from urllib.parse import quote, urlencode, urlsplit

from qgis.core import QgsBlockingNetworkRequest, QgsFeedback, QgsProcessingException
from qgis.PyQt.QtCore import QByteArray, QFile, QIODevice, QUrl
from qgis.PyQt.QtNetwork import QNetworkRequest

from .words import either, language

KEY_VARIABLE = "VERSANT_KEY"
"""Holds a key where no login of QGIS is chosen: for scripts."""
JSON = "application/json"


class Service:
    """One service, as one run of an algorithm asks it."""

    def __init__(self, address: str, authcfg: str, feedback: QgsFeedback) -> None:
        """``authcfg``: a stored login of QGIS, or nothing. An address that is none is a QgsProcessingException."""
        self.address = address.strip().rstrip("/")
        parts = urlsplit(self.address)
        if parts.scheme not in ("http", "https") or not parts.hostname:
            raise QgsProcessingException(
                either(
                    f"The address of the service is not one: {address}. It begins with http:// or https://.",
                    f"Die Adresse des Dienstes ist keine: {address}. Sie beginnt mit http:// oder https://.",
                )
            )
        self._authcfg = authcfg
        self._feedback = feedback

    def get(self, path: str, **query: Any) -> Any:
        """The JSON that is answered."""
        return self.get_query(path, urlencode(query))

    def get_query(self, path: str, query: str) -> Any:
        """The same of a query that is written already."""
        asking = self._asking()
        asking.get(self._request(path, query), True, self._feedback)
        return self._answer(asking)

    def post(self, path: str, document: Any) -> Any:
        """The JSON that is answered to JSON."""
        asking = self._asking()
        body = QByteArray(json.dumps(document).encode())
        asking.post(self._request(path, "", JSON), body, True, self._feedback)
        return self._answer(asking)

    def post_file(self, path: str, file: Path) -> Any:
        """The JSON that is answered to a file, which is sent piece by piece under its own name."""
        body = QFile(str(file))
        if not body.open(QIODevice.ReadOnly):
            raise QgsProcessingException(f"{file}: {body.errorString()}")
        try:
            asking = self._asking()
            query = urlencode({"filename": file.name}, quote_via=quote)
            asking.post(self._request(path, query, "application/octet-stream"), body, True, self._feedback)
            return self._answer(asking)
        finally:
            body.close()

    def _asking(self) -> QgsBlockingNetworkRequest:
        asking = QgsBlockingNetworkRequest()
        asking.setAuthCfg(self._authcfg)
        return asking

    def _request(self, path: str, query: str, content_type: str = "") -> QNetworkRequest:
        address = f"{self.address}{path}" + (f"?{query}" if query else "")
        request = QNetworkRequest(QUrl.fromEncoded(address.encode()))
        request.setRawHeader(b"Accept-Language", language().encode())
        if content_type:
            request.setHeader(QNetworkRequest.ContentTypeHeader, content_type)
        key = os.environ.get(KEY_VARIABLE, "")
        if key and not self._authcfg:
            request.setRawHeader(b"Authorization", f"Bearer {key}".encode())
        return request

    def _answer(self, asked: QgsBlockingNetworkRequest) -> Any:
        """What was answered; a QgsProcessingException with the service's own sentence where it refuses."""
        reply = asked.reply()
        status = reply.attribute(QNetworkRequest.HttpStatusCodeAttribute)
        try:
            document = json.loads(bytes(reply.content()))
        except ValueError:
            document = None
        if status is not None and 200 <= int(status) < 300 and document is not None:
            return document
        if self._feedback.isCanceled():
            raise QgsProcessingException(either("Cancelled.", "Abgebrochen."))
        told = document.get("detail") if isinstance(document, dict) else None
        if told:
            raise QgsProcessingException(str(told))
        reason = asked.errorMessage() or (
            either("this is no Versant service", "das ist kein Versant-Dienst") if status else "-"
        )
        raise QgsProcessingException(
            either(f"{self.address} does not answer: {reason}", f"{self.address} antwortet nicht: {reason}")
        )
