"""A phone's browser on the road: its clock, its positions and what its motion sensors feel are simulated."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from datetime import UTC, datetime
from typing import Any

from browser_fixtures import Tab

FEEL = """([x, y, z, alpha]) => dispatchEvent(new DeviceMotionEvent('devicemotion', {
  accelerationIncludingGravity: {x, y, z}, rotationRate: {alpha, beta: 0, gamma: 0}}))"""
COUNTED = "Number(document.querySelectorAll('.figures dd')[2]?.textContent ?? 0)"
"""The third figure of the page counts positions."""
BEGAN_S = 1_700_000_000.0


class Phone:
    """A tab whose clock stands at ``began_s`` and goes on by itself, and faster with each second of a drive.

    Positions of a browser that is simulated have the times of this machine, hours away from that clock's; the page
    takes the clock's then.
    """

    def __init__(self, tab: Tab, began_s: float = BEGAN_S) -> None:
        self.tab = tab
        tab.page.context.grant_permissions(["geolocation", "accelerometer", "gyroscope"])
        tab.page.clock.install(time=datetime.fromtimestamp(began_s, UTC))
        self._browser = tab.page.context.new_cdp_session(tab.page)

    def stand(self, row: Mapping[str, str]) -> None:
        """Be where a row of a log is, by the names of Versant's CSV."""
        known: dict[str, Any] = {
            "latitude": float(row["lat_deg"]),
            "longitude": float(row["lon_deg"]),
            "accuracy": 3.0,
        }
        if row.get("alt_msl_m"):
            known |= {"altitude": float(row["alt_msl_m"]), "altitudeAccuracy": 4.0}
        self._browser.send("Emulation.setGeolocationOverride", known)

    def second(self) -> None:
        """A second goes by, in which the phone lies on its back."""
        for _ in range(2):
            self.tab.page.evaluate(FEEL, [0.1, 0.2, 9.8, 1.0])
            self.tab.page.clock.run_for(500)

    @property
    def counted(self) -> int:
        """How many positions the page has counted."""
        return int(self.tab.page.evaluate(COUNTED))

    def drive(self, rows: Iterable[Mapping[str, str]]) -> None:
        """Be at each row for a second; the page counts each."""
        for row in rows:
            before = self.counted
            self.stand(row)
            self.tab.await_true(f"{COUNTED} > {before}")
            self.second()
