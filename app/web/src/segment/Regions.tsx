/** Goes to one of the imported regions. Nothing is shown while there is nothing to choose. */
import { useEffect, useState } from "preact/hooks";
import { flyTo } from "../map/state";
import { getJson } from "../shared/api";
import { t } from "../shared/texts";

interface Region {
  name: string;
  segments: number;
  bbox: [number, number, number, number] | null;
}

export function Regions() {
  const [regions, set] = useState<Region[]>([]);
  useEffect(() => {
    const ended = new AbortController();
    getJson<{ regions: Region[] }>("/v1/regions", ended.signal).then(
      (answer) => set(answer.regions.filter((one) => one.bbox !== null)),
      // The map is there without a choice of regions.
      () => {},
    );
    return () => ended.abort();
  }, []);
  if (regions.length === 0) return null;
  return (
    <label class="regions">
      <span class="regions-name">{t("segment.region")}</span>
      <select
        value=""
        onChange={(event) => {
          const bbox = regions.find((one) => one.name === event.currentTarget.value)?.bbox;
          event.currentTarget.value = "";
          if (bbox) flyTo({ bbox });
        }}
      >
        <option value="">{t("segment.region_choose")}</option>
        {regions.map((one) => (
          <option key={one.name} value={one.name}>
            {t("segment.region_named", { name: one.name, n: one.segments })}
          </option>
        ))}
      </select>
    </label>
  );
}
