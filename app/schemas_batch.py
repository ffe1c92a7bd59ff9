"""The JSON documents of drives that are processed again by the thousand."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict, Field

from app.schemas import Link

EXAMPLE_BATCH = "http://127.0.0.1:8000/v1/drives/reprocess?batch=1795166382004000"


class BatchAccepted(BaseModel):
    """The answer to a request to process many drives again."""

    model_config = ConfigDict(
        json_schema_extra={
            "examples": [
                {
                    "queued": 12,
                    "method": "raw",
                    "links": [{"href": EXAMPLE_BATCH, "rel": "monitor", "type": "application/json"}],
                }
            ]
        }
    )

    queued: int = Field(description="Drives that wait to be processed again.")
    method: str
    links: list[Link]


class Batch(BaseModel):
    """How far many drives are that are processed again."""

    model_config = ConfigDict(
        json_schema_extra={
            "examples": [
                {
                    "drives": 12,
                    "queued": 4,
                    "running": 1,
                    "done": 6,
                    "failed": 1,
                    "progress": 0.6125,
                    "links": [{"href": EXAMPLE_BATCH, "rel": "self", "type": "application/json"}],
                }
            ]
        }
    )

    drives: int
    queued: int
    running: int
    done: int
    failed: int
    progress: float = Field(ge=0, le=1, description="Share of the work done, 0..1; 1: nothing is left to do.")
    links: list[Link]
