"""The routes of the API. A new group is one module and one line here."""

from __future__ import annotations

from fastapi import APIRouter

from app.routes import (
    admin,
    batches,
    drive_parts,
    drives,
    events,
    features,
    health,
    problem_kinds,
    segments,
    tiles,
    upload,
)

ROUTERS: tuple[APIRouter, ...] = (
    upload.router,
    batches.router,  # before drives: its path would else be taken for a drive's
    drives.router,
    events.router,
    drive_parts.router,
    segments.router,
    features.router,
    tiles.router,
    admin.router,
    health.router,
    problem_kinds.router,
)
