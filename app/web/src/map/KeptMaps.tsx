/** Of which moment the map is: today's, or one that was kept as an export. Nothing is shown where none is kept. */
import { useEffect, useState } from "preact/hooks";
import { moment } from "../shared/format";
import { may } from "../shared/session";
import { t } from "../shared/texts";
import { type Export, keptMaps, searchOf } from "./keeping";
import { kept } from "./shown";
import { address, keptId, present } from "./state";

const nameOf = (one: Export) =>
  one.request["bbox"] ? t("map.kept_part", { moment: moment(one.started_at) }) : moment(one.started_at);

/** Says that it is no map of today. */
export function KeptNotice() {
  if (kept.value === null) return null;
  return (
    <p class="kept card" role="status">
      {t("map.kept", { moment: moment(kept.value.moment) })}{" "}
      <a href={`/map${address(present(), "")}`}>{t("map.kept_leave")}</a>
    </p>
  );
}

/** Chooses another; the page opens anew. */
export function KeptMaps() {
  const [maps, set] = useState<Export[]>([]);
  useEffect(() => {
    if (!may("own")) return;
    const ended = new AbortController();
    // The map is there without a choice of kept ones.
    keptMaps(ended.signal).then(set, () => {});
    return () => ended.abort();
  }, []);
  if (maps.length === 0) return null;
  return (
    <label class="choice">
      <span>{t("map.kept_choose")}</span>
      <select
        value={kept.value ? (keptId ?? "") : ""}
        onChange={(event) => location.assign(`/map${searchOf(event.currentTarget.value || null)}`)}
      >
        <option value="">{t("map.kept_today")}</option>
        {maps.map((one) => (
          <option key={one.id} value={one.id}>
            {nameOf(one)}
          </option>
        ))}
      </select>
    </label>
  );
}
