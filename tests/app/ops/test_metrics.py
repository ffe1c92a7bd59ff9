"""What Prometheus reads."""

from __future__ import annotations

from typing import Any


def test_metrics_count_requests_by_route(reading: Any) -> None:
    reading.client.get("/v1/segments/1")
    reading.client.get("/v1/segments/999999")
    text = reading.client.get("/metrics").text
    for status in (200, 404):
        assert f'route="/v1/segments/{{segment_id}}",status="{status}"' in text
    assert 'versant_drives{status="done"} 2.0' in text
    assert "versant_queue_depth 0.0" in text
    assert "versant_database_up 1.0" in text
    assert "/v1/segments/1" not in text, "a series per segment would never end"
