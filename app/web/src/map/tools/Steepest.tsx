/** The steepest streets of what is seen. One request for each view that the map comes to rest in, and for each change in it. */
import { useEffect, useState } from "preact/hooks";
import { choose } from "../../segment/choosing";
import type { Segment } from "../../segment/data";
import { roadClass } from "../../segment/words";
import { getJson } from "../../shared/api";
import { distance, number } from "../../shared/format";
import { errorText } from "../../shared/Messages";
import { t } from "../../shared/texts";
import { freeBox } from "../free";
import { marks } from "../marks";
import { changes, shownMap } from "../shown";
import { flyTo, leastDrives, mostSigma, view } from "../state";
import { type Street, streetsOf } from "./streets";

/** Farther out it would be a question to all of the country. */
const LEAST_ZOOM = 12;
const SETTLED_MS = 400;
const MOST_SEGMENTS = 200;
const PROPERTIES = "name,osm_way_id,highway,length_m,slope_percent,slope_sigma_percent";

function query(box: readonly number[]): string {
  const filters = [
    ...(mostSigma.value === null ? [] : [`slope_sigma_percent<=${mostSigma.value}`]),
    ...(leastDrives.value > 0 ? [`drives>=${leastDrives.value}`] : []),
  ];
  const asked = new URLSearchParams({
    bbox: box.map((one) => one.toFixed(5)).join(","),
    sortby: "-steepness_percent",
    driven: "true",
    limit: String(MOST_SEGMENTS),
    properties: PROPERTIES,
    ...(filters.length > 0 ? { filter: filters.join(" AND ") } : {}),
  });
  return `/collections/segments/items?${asked}`;
}

/** The last answer: whoever comes back from a street finds its list. */
let last: { asked: string; asOf: number; streets: Street[] } | null = null;

const figure = ({ steepness_percent, sigma_percent }: Street) =>
  `${number(steepness_percent, 1)} ± ${number(sigma_percent, 1)} %`;

export default function Steepest() {
  const [streets, set] = useState<Street[] | null>(last?.streets ?? null);
  const [why, fail] = useState("");
  const map = shownMap.value;
  const now = view.value;
  const asOf = changes.value;
  const far = now !== null && now.zoom < LEAST_ZOOM;
  useEffect(() => {
    if (!map || far) return;
    const ended = new AbortController();
    const ask = async () => {
      // A map on its way tells when it has come to rest.
      if (map.isMoving()) return;
      const asked = query(freeBox(map));
      if (last?.asked !== asked || last.asOf !== asOf) {
        const page = await getJson<{ features: Segment[] }>(asked, ended.signal);
        last = { asked, asOf, streets: streetsOf(page.features) };
      }
      set(last.streets);
      fail("");
    };
    const timer = setTimeout(() => {
      ask().catch((error) => {
        if (!ended.signal.aborted) fail(errorText(error));
      });
    }, SETTLED_MS);
    return () => {
      clearTimeout(timer);
      ended.abort();
    };
  }, [map, now, far, asOf, mostSigma.value, leastDrives.value]);
  const point = (one: Street | null) => () => {
    marks.value = one ? [{ kind: "street", at: one.line }] : [];
  };
  useEffect(() => point(null), []);
  if (far)
    return (
      <p class="note" role="status">
        {t("tools.steepest.nearer")}{" "}
        <button type="button" onClick={() => flyTo({ ...now, zoom: LEAST_ZOOM + 0.2 })}>
          {t("map.zoom_there")}
        </button>
      </p>
    );
  return (
    <>
      <p class="quiet-text small">{t("tools.steepest.how")}</p>
      <p class={why ? "error-text" : "unseen"} role="status">
        {why || (streets ? t("tools.steepest.found", { n: streets.length }) : t("segment.asking"))}
      </p>
      {streets?.length === 0 && <p class="note">{t("tools.steepest.none")}</p>}
      <ol class="segments">
        {streets?.map((one) => (
          <li key={one.key}>
            <button
              type="button"
              class="quiet"
              onMouseEnter={point(one)}
              onMouseLeave={point(null)}
              onFocus={point(one)}
              onBlur={point(null)}
              onClick={() => choose("segment", one.id)}
            >
              <span>{one.name ?? roadClass(one.highway)}</span>
              <span class="number">{distance(one.length_m)}</span>
              <b class="number">{figure(one)}</b>
            </button>
          </li>
        ))}
      </ol>
    </>
  );
}
