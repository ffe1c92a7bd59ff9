/** What the charts of a drive draw, as columns over the rows of its profile. */

import type { ChartColour, Line, Stretch } from "../shared/chart/lines";
import { t } from "../shared/texts";
import type { Aligned } from "./align";
import type { DriveSegment, Profile, Sensor } from "./data";
import { nameOf } from "./sentences";
import { type Kind, rowAt, runsOf } from "./stretches";

type Column = (number | null)[];

/** A measurement belongs to no row that is farther away in time, unless rows themselves are farther apart. */
const NEAR_S = 2;

const COLOURS: Record<string, ChartColour> = {
  altitude: "other",
  barometer: "quiet",
  doppler: "other",
  pitch: "danger",
  "specific force": "model",
};
const HIDDEN = new Set(["doppler", "pitch", "specific force"]);

/** Each measurement at the row nearest in time; where several fall to one, the nearest. */
export function onRows(time_s: readonly number[], sensor: Sensor): Column {
  const out: Column = new Array(time_s.length).fill(null);
  const away = new Float64Array(time_s.length).fill(Number.POSITIVE_INFINITY);
  sensor.time_s.forEach((at, k) => {
    const row = rowAt(time_s, at);
    const value = sensor.value[k] ?? null;
    if (row < 0 || value === null) return;
    const spacing = Math.abs(
      (time_s[Math.min(row + 1, time_s.length - 1)] as number) - (time_s[Math.max(row - 1, 0)] as number),
    );
    const off = Math.abs((time_s[row] as number) - at);
    if (off > Math.max(NEAR_S, spacing / 2) || off >= (away[row] as number)) return;
    away[row] = off;
    out[row] = value;
  });
  return out;
}

/** Sensors as dots: heights moved where their datum is another one. */
export function sensorLines(profile: Profile, sensors: readonly Sensor[], heights: boolean): Line[] {
  return sensors
    .filter((sensor) => sensor.is_height === heights && sensor.name !== "dem")
    .map((sensor): Line => {
      const shift = sensor.shift_m ?? 0;
      const values = onRows(profile.time_s, sensor);
      const name = nameOf("sensor", sensor.name);
      return {
        label: shift ? t("drive.chart.moved", { name, by: Math.round(shift) }) : name,
        values: shift ? values.map((value) => (value === null ? null : value + shift)) : values,
        colour: COLOURS[sensor.name] ?? "quiet",
        unit: heights ? "m" : "%",
        decimals: 1,
        points: true,
        dot: 3,
        hidden: HIDDEN.has(sensor.name),
      };
    });
}

/** What all drives together say of the segments, in the direction of travel. */
export function combinedColumn(profile: Profile, segments: ReadonlyMap<number, DriveSegment>): Column {
  return profile.segment_id.map((id, row) => {
    const slope = id === null ? null : segments.get(id)?.properties.combined_slope_percent;
    const forward = profile.forward[row];
    return slope === null || slope === undefined || forward === null ? null : forward ? slope : -slope;
  });
}

/** A column of another estimate at the rows of the first, between its own places; null where it has none beside. */
export function resampled(along_m: readonly number[], values: Column, rows_m: readonly number[]): Column {
  let k = 0;
  return rows_m.map((at) => {
    while (k + 1 < along_m.length && (along_m[k + 1] as number) < at) k += 1;
    const from = along_m[k];
    const to = along_m[k + 1];
    const a = values[k] ?? null;
    const b = values[k + 1] ?? null;
    if (from === undefined || at < from) return at === from ? a : null;
    if (to === undefined) return at === from ? a : null;
    if (at > to || a === null || b === null) return at === from ? a : at === to ? b : null;
    return to > from ? a + ((b - a) * (at - from)) / (to - from) : a;
  });
}

/** The other estimate as a line over the rows of the first: its heights or its grades. */
export function otherLine(profile: Profile, aligned: Aligned, name: string, heights: boolean): Line {
  const on = (values: Column) => resampled(aligned.along_m, values, profile.distance_m);
  return {
    label: name,
    values: on(heights ? aligned.height_m : aligned.grade_percent),
    sigma: on(heights ? aligned.height_sigma_m : aligned.grade_sigma_percent),
    colour: "fourth",
    unit: heights ? "m" : "%",
    dashed: true,
  };
}

const STRETCH: Partial<Record<Kind, ChartColour>> = {
  unmatched: "danger",
  blind: "quiet",
  contradicts: "model",
};

/** What stands out along the axis. */
export function stretchesOf(profile: Profile, kinds: readonly Kind[]): Stretch[] {
  return runsOf(profile, (row) => kinds[row]).flatMap((run) => {
    const colour = STRETCH[kinds[run.first] as Kind];
    return colour ? [{ from: run.from_m, to: run.to_m, colour }] : [];
  });
}
