/** Goes to where the visitor is, or says plainly why not. */
import { useState } from "preact/hooks";
import { flyTo } from "../map/state";
import { ApiProblem } from "../shared/api";
import { tellError } from "../shared/Messages";
import { t } from "../shared/texts";

const PATIENCE_MS = 15_000;
const REASONS = { 1: "refused", 2: "unavailable", 3: "slow" } as const;

function tell(reason: "refused" | "unavailable" | "slow" | "insecure"): void {
  const text = t(`segment.locate_${reason}`);
  tellError(new ApiProblem(0, text, text));
}

export function Locate() {
  const [asking, set] = useState(false);
  const press = () => {
    if (!window.isSecureContext || !("geolocation" in navigator)) return tell("insecure");
    set(true);
    navigator.geolocation.getCurrentPosition(
      ({ coords }) => {
        set(false);
        flyTo({ lon: coords.longitude, lat: coords.latitude, zoom: 16 });
      },
      (error) => {
        set(false);
        tell(REASONS[error.code as 1 | 2 | 3] ?? "unavailable");
      },
      { enableHighAccuracy: true, timeout: PATIENCE_MS, maximumAge: 60_000 },
    );
  };
  return (
    <button type="button" class="locate" disabled={asking} onClick={press} title={t("segment.locate")}>
      <svg viewBox="0 0 20 20" width="18" height="18" aria-hidden="true">
        <circle cx="10" cy="10" r="5.5" fill="none" stroke="currentColor" stroke-width="1.6" />
        <circle cx="10" cy="10" r="2" fill="currentColor" />
        <path d="M10 1v4M10 15v4M1 10h4M15 10h4" stroke="currentColor" stroke-width="1.6" />
      </svg>
      <span class="unseen">{t(asking ? "segment.locating" : "segment.locate")}</span>
    </button>
  );
}
