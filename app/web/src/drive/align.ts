/**
 * Two estimates side by side, over one axis: the distance that the first one drove.
 *
 * Two methods on one log have their times in common and nothing else: by noise in their positions the way is longer by
 * one than by the other, so distances driven would drift apart. Their rows are placed by time. Two drives have roads in
 * common: the other's rows are placed where the first one passed the same place of the same segment, and what it drove
 * elsewhere is not shown. Where it drove against the first one's direction, its grade is turned.
 */
import type { DriveSegment, Profile } from "./data";
import { rowAt, stays } from "./stretches";

/** Rows of another estimate on the first one's axis, ascending; `null` before each interruption. */
export interface Aligned {
  along_m: number[];
  height_m: (number | null)[];
  height_sigma_m: (number | null)[];
  grade_percent: (number | null)[];
  grade_sigma_percent: (number | null)[];
  /** How much of the first one's way the other one covers, m. */
  shared_m: number;
}

function empty(): Aligned {
  return {
    along_m: [],
    height_m: [],
    height_sigma_m: [],
    grade_percent: [],
    grade_sigma_percent: [],
    shared_m: 0,
  };
}

function take(into: Aligned, other: Profile, row: number, at_m: number, sign: number): void {
  const grade = other.grade_percent[row] ?? null;
  into.along_m.push(at_m);
  into.height_m.push(other.alt_m[row] ?? null);
  into.height_sigma_m.push(other.alt_sigma_m[row] ?? null);
  into.grade_percent.push(grade === null ? null : sign * grade);
  into.grade_sigma_percent.push(other.grade_sigma_percent[row] ?? null);
}

function pause(into: Aligned, at_m: number): void {
  into.along_m.push(at_m);
  into.height_m.push(null);
  into.height_sigma_m.push(null);
  into.grade_percent.push(null);
  into.grade_sigma_percent.push(null);
}

/** Another method's rows on the first one's axis, by time. */
export function alignedByTime(first: Profile, other: Profile): Aligned {
  const time = first.time_s;
  const out = empty();
  let before = Number.NEGATIVE_INFINITY;
  for (let row = 0; row < other.time_s.length; row += 1) {
    const at = other.time_s[row] as number;
    if (time.length === 0 || at < (time[0] as number) || at > (time[time.length - 1] as number)) continue;
    const near = rowAt(time, at);
    const low = (time[near] as number) > at ? near - 1 : near;
    const high = Math.min(low + 1, time.length - 1);
    const span = (time[high] as number) - (time[low] as number);
    const share = span > 0 ? (at - (time[low] as number)) / span : 0;
    const from = first.distance_m[low] as number;
    const along = from + share * ((first.distance_m[high] as number) - from);
    if (other.gap[row] && out.along_m.length > 0) pause(out, along);
    else if (out.along_m.length > 0) out.shared_m += Math.max(along - before, 0);
    take(out, other, row, along, 1);
    before = along;
  }
  return out;
}

type Stay = ReturnType<typeof stays>[number];

/** The stays of the other drive that go with those of the first: the same direction before the other, the first passage before the second. */
function partners(first: Profile, other: Profile): [Stay, Stay][] {
  const bySegment = new Map<number, Stay[]>();
  for (const stay of stays(other)) {
    const those = bySegment.get(stay.segment);
    if (those) those.push(stay);
    else bySegment.set(stay.segment, [stay]);
  }
  const passed = new Map<string, number>();
  return stays(first).flatMap((mine): [Stay, Stay][] => {
    const there = bySegment.get(mine.segment) ?? [];
    const along = first.forward[mine.first];
    const alike = there.filter((stay) => other.forward[stay.first] === along);
    const choice = alike.length > 0 ? alike : there;
    const key = `${mine.segment} ${along}`;
    const count = passed.get(key) ?? 0;
    passed.set(key, count + 1);
    const theirs = choice[Math.min(count, choice.length - 1)];
    return theirs ? [[mine, theirs]] : [];
  });
}

/** Distance on the first one's axis of the place of a stay that is nearest to (lon, lat). */
function placeOn(first: Profile, stay: Stay, lon: number, lat: number): number {
  const narrow = Math.cos((lat * Math.PI) / 180);
  let best = stay.from_m;
  let least = Number.POSITIVE_INFINITY;
  // One row beyond each end, if it belongs together: between rows of neighbouring segments lies half of the way.
  const from = stay.first > 0 && !first.gap[stay.first] ? stay.first - 1 : stay.first;
  const to = stay.last + 1 < first.lon_deg.length && !first.gap[stay.last + 1] ? stay.last + 1 : stay.last;
  for (let row = from; row <= to; row += 1) {
    const after = Math.min(row + 1, to);
    const x0 = ((first.lon_deg[row] as number) - lon) * narrow;
    const y0 = (first.lat_deg[row] as number) - lat;
    const dx = ((first.lon_deg[after] as number) - (first.lon_deg[row] as number)) * narrow;
    const dy = (first.lat_deg[after] as number) - (first.lat_deg[row] as number);
    const length2 = dx * dx + dy * dy;
    const share = length2 > 0 ? Math.min(Math.max(-(x0 * dx + y0 * dy) / length2, 0), 1) : 0;
    const away = Math.hypot(x0 + share * dx, y0 + share * dy);
    if (away >= least) continue;
    least = away;
    const start = first.distance_m[row] as number;
    best = start + share * ((first.distance_m[after] as number) - start);
  }
  return Math.min(Math.max(best, stay.from_m), stay.to_m);
}

/** Another drive's rows on the first one's axis, by the segments that both drove. */
export function alignedByRoad(first: Profile, other: Profile): Aligned {
  const out = empty();
  let last: Stay | null = null;
  for (const [mine, theirs] of partners(first, other)) {
    const against = other.forward[theirs.first] !== first.forward[mine.first];
    const together = last !== null && mine.first === last.last + 1 && !first.gap[mine.first];
    if (out.along_m.length > 0 && !together) pause(out, mine.from_m);
    const rows: [number, number][] = [];
    for (let row = theirs.first; row <= theirs.last; row += 1)
      rows.push([placeOn(first, mine, other.lon_deg[row] as number, other.lat_deg[row] as number), row]);
    rows.sort((a, b) => a[0] - b[0]);
    for (const [at, row] of rows) take(out, other, row, at, against ? -1 : 1);
    out.shared_m += mine.to_m - mine.from_m;
    last = mine;
  }
  return out;
}

/** A segment that both estimates know; slopes from its from_node to its to_node. */
export interface Pair {
  segment: DriveSegment;
  first: [number, number];
  other: [number, number];
  difference: number;
  /** Of the difference, as if the two were independent. */
  sigma: number;
  sigmas: number;
}

/** Segments of both, in the order of the first. */
export function pairsOf(first: readonly DriveSegment[], other: readonly DriveSegment[]): Pair[] {
  const theirs = new Map(other.map((one) => [one.id, one]));
  return first.flatMap((segment): Pair[] => {
    const a = segment.properties;
    const b = theirs.get(segment.id)?.properties;
    if (!b || a.slope_percent === null || b.slope_percent === null) return [];
    const own = a.slope_sigma_percent ?? Number.NaN;
    const its = b.slope_sigma_percent ?? Number.NaN;
    const difference = b.slope_percent - a.slope_percent;
    const sigma = Math.hypot(own, its);
    return [
      {
        segment,
        first: [a.slope_percent, own],
        other: [b.slope_percent, its],
        difference,
        sigma,
        sigmas: Math.abs(difference) / sigma,
      },
    ];
  });
}

export interface Agreement {
  segments: number;
  median: number;
  rms: number;
  /** Share within two sigmas of the difference; 0.95 if sigmas are right and the two are independent. */
  within: number;
}

/** How far two estimates agree; null without a common segment. */
export function agreementOf(pairs: readonly Pair[]): Agreement | null {
  if (pairs.length === 0) return null;
  const differences = pairs.map((pair) => pair.difference).sort((a, b) => a - b);
  const middle = differences.length >> 1;
  const median =
    differences.length % 2 === 1
      ? (differences[middle] as number)
      : ((differences[middle - 1] as number) + (differences[middle] as number)) / 2;
  return {
    segments: pairs.length,
    median,
    rms: Math.sqrt(differences.reduce((sum, one) => sum + one * one, 0) / pairs.length),
    within: pairs.filter((pair) => pair.sigmas <= 2).length / pairs.length,
  };
}
