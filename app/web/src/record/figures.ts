/** What is counted while positions come in. */
import type { Fix } from "./samples";

/** Of a whole recording, over all its runs. */
export interface Totals {
  positions: number;
  motions: number;
  distance_m: number;
  /** How long it was recorded, pauses left out. */
  ran_ms: number;
  /** Of the last position; NaN before the first. */
  last_ms: number;
  /** Of samples as they are kept. */
  bytes: number;
  /** How often positions stayed away, and the longest time. */
  gaps: number;
  longest_gap_ms: number;
}

export const NOTHING: Totals = {
  positions: 0,
  motions: 0,
  distance_m: 0,
  ran_ms: 0,
  last_ms: Number.NaN,
  bytes: 0,
  gaps: 0,
  longest_gap_ms: 0,
};

/** Positions come every second: what takes longer is a gap, in which a slope may change unseen. */
export const GAP_MS = 5000;
const LEAST_STEP_M = 10;
const MOST_STEP_M = 50;
const EARTH_RADIUS_M = 6_371_000;

/** Metres between two places. */
export function metresBetween(a: Fix, b: Fix): number {
  const radians = Math.PI / 180;
  const north = (b.lat_deg - a.lat_deg) * radians;
  const east = (((b.lon_deg - a.lon_deg + 540) % 360) - 180) * radians;
  const half =
    Math.sin(north / 2) ** 2 +
    Math.cos(a.lat_deg * radians) * Math.cos(b.lat_deg * radians) * Math.sin(east / 2) ** 2;
  return 2 * EARTH_RADIUS_M * Math.asin(Math.sqrt(half));
}

/** Counts the positions of one run; between runs nothing is counted as driven or lost. */
export class Counting {
  private from: Fix | null = null;
  private last_ms = Number.NaN;

  constructor(public totals: Totals) {}

  /** Whether the position is a new one: browsers may tell one twice. */
  add(fix: Fix): boolean {
    if (fix.time_ms <= this.totals.last_ms) return false;
    const totals = { ...this.totals, positions: this.totals.positions + 1, last_ms: fix.time_ms };
    const waited_ms = fix.time_ms - this.last_ms;
    if (waited_ms > GAP_MS) {
      totals.gaps += 1;
      totals.longest_gap_ms = Math.max(totals.longest_gap_ms, waited_ms);
    }
    totals.distance_m += this.driven(fix);
    this.last_ms = fix.time_ms;
    this.totals = totals;
    return true;
  }

  /** Metres since the place that was counted last; who stands still drives nowhere, though positions wander. */
  private driven(fix: Fix): number {
    if (this.from === null) {
      this.from = fix;
      return 0;
    }
    const metres = metresBetween(this.from, fix);
    if (metres < Math.min(Math.max(fix.h_acc_m, LEAST_STEP_M), MOST_STEP_M)) return 0;
    this.from = fix;
    return metres;
  }
}
