/** Rows of figures over time as lines: a common axis of seconds, unknown is a gap. */
import { t } from "../../shared/texts";
import type { Growth, Throughput } from "../types";

export interface Line {
  label: string;
  values: (number | null)[];
}

export interface Lines {
  /** Unix seconds, ascending. */
  times: number[];
  lines: Line[];
}

const MOST_LINES = 6;

function seconds(at: string): number {
  return Date.parse(at.includes("T") ? at : `${at}T00:00:00Z`) / 1000;
}

function byTime<Row>(rows: Row[], at: (row: Row) => string): Row[] {
  return [...rows].sort((a, b) => seconds(at(a)) - seconds(at(b)));
}

const HOUR_S = 3600;
const DAY_S = 24 * HOUR_S;
/** The service tells so many days by the hour, more by the day. */
export const HOURLY_DAYS = 2;

/** Drives that ended; an hour or a day of which nothing is told had none. */
export function throughputSeries(rows: Throughput[], days: number, nowS = Date.now() / 1000): Lines {
  const sorted = byTime(rows, (row) => row.at);
  const first = sorted[0];
  const step = days <= HOURLY_DAYS ? HOUR_S : DAY_S;
  const rowAt = new Map(sorted.map((row) => [seconds(row.at), row]));
  const times: number[] = [];
  if (first) for (let at = seconds(first.at); at <= nowS; at += step) times.push(at);
  return {
    times,
    lines: [
      { label: t("admin.status.done"), values: times.map((at) => rowAt.get(at)?.done ?? 0) },
      {
        label: t("admin.status.failed"),
        values: times.map((at) => (rowAt.get(at)?.failed ?? 0) - (rowAt.get(at)?.waiting ?? 0)),
      },
      ...(sorted.some((row) => row.waiting)
        ? [{ label: t("roads.waits"), values: times.map((at) => rowAt.get(at)?.waiting ?? 0) }]
        : []),
    ],
  };
}

/** What drives' time went into, of the hours or days in which any was done. */
export function stageSeries(rows: Throughput[]): Lines {
  const sorted = byTime(
    rows.filter((row) => row.done > 0),
    (row) => row.at,
  );
  return {
    times: sorted.map((row) => seconds(row.at)),
    lines: [
      { label: t("admin.times.waited"), values: sorted.map((row) => row.waited_p50_s) },
      { label: t("admin.times.computed"), values: sorted.map((row) => row.computed_p50_s) },
      { label: t("admin.times.published"), values: sorted.map((row) => row.published_p50_s) },
    ],
  };
}

/** Kilometres driven by class: the longest classes each, the others together; a day without a row is as the one before. */
export function growthSeries(rows: Growth[]): Lines {
  const dates = [...new Set(rows.map((row) => row.day))].sort();
  const km = new Map(rows.map((row) => [`${row.highway} ${row.day}`, row.driven_km]));
  const last = new Map(byTime(rows, (row) => row.day).map((row) => [row.highway, row.driven_km]));
  const classes = [...last].sort((a, b) => b[1] - a[1]).map(([highway]) => highway);
  const carried = (highway: string) => {
    let before: number | null = null;
    return dates.map((day) => {
      before = km.get(`${highway} ${day}`) ?? before;
      return before;
    });
  };
  const shown = classes.length > MOST_LINES ? classes.slice(0, MOST_LINES - 1) : classes;
  const lines = shown.map((highway) => ({ label: highway, values: carried(highway) }));
  const rest = classes.slice(shown.length).map(carried);
  if (rest.length > 0)
    lines.push({
      label: t("admin.coverage.others"),
      values: dates.map((_, k) => rest.reduce<number | null>((sum, one) => plus(sum, one[k] ?? null), null)),
    });
  return { times: dates.map(seconds), lines };
}

function plus(a: number | null, b: number | null): number | null {
  return a === null ? b : b === null ? a : a + b;
}
