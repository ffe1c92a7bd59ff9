/** Parts of a drive on the axis of the distance driven: what was matched, what was not, which segment was where. */
import type { Profile } from "./data";

/** Rows `first` to `last` of a profile, which reach from `from_m` to `to_m`. */
export interface Stretch {
  first: number;
  last: number;
  from_m: number;
  to_m: number;
}

export type Kind = "matched" | "unmatched" | "blind" | "contradicts";

/**
 * Runs of rows of one value. They meet halfway between the last row of one and the first of the next, but not across
 * an interruption.
 */
export function runsOf(profile: Profile, valueAt: (row: number) => unknown): Stretch[] {
  const runs: Stretch[] = [];
  const along = profile.distance_m;
  let first = 0;
  for (let row = 1; row <= along.length; row += 1) {
    const ends = row === along.length || profile.gap[row] || valueAt(row) !== valueAt(row - 1);
    if (!ends) continue;
    runs.push({ first, last: row - 1, from_m: along[first] as number, to_m: along[row - 1] as number });
    first = row;
  }
  for (let k = 1; k < runs.length; k += 1) {
    const before = runs[k - 1] as Stretch;
    const after = runs[k] as Stretch;
    if (profile.gap[after.first]) continue;
    const border = (before.to_m + after.from_m) / 2;
    before.to_m = border;
    after.from_m = border;
  }
  return runs;
}

/** What each row of a profile is: on a road or not, without a measured position, where other drives say otherwise. */
export function kindsOf(profile: Profile, rejected: ReadonlySet<number>): Kind[] {
  return profile.segment_id.map((segment, row) => {
    if (segment === null) return "unmatched";
    if (rejected.has(segment)) return "contradicts";
    return profile.has_gnss[row] ? "matched" : "blind";
  });
}

/** Stays on segments, in the order of driving. */
export function stays(profile: Profile): (Stretch & { segment: number })[] {
  return runsOf(profile, (row) => `${profile.segment_id[row]} ${profile.forward[row]}`).flatMap((run) => {
    const segment = profile.segment_id[run.first];
    return segment === null || segment === undefined ? [] : [{ ...run, segment }];
  });
}

/** The row nearest to a distance; rows ascend. -1: there is none. */
export function rowAt(along_m: ArrayLike<number>, at_m: number): number {
  let low = 0;
  let high = along_m.length - 1;
  if (high < 0) return -1;
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if ((along_m[middle] as number) <= at_m) low = middle;
    else high = middle;
  }
  return at_m - (along_m[low] as number) <= (along_m[high] as number) - at_m ? low : high;
}

/**
 * The row whose place is nearest, or null where none is within `reach_deg` of latitude. Where a street was driven more
 * than once, of the rows about as near the one nearest along to `before`.
 */
export function rowNear(
  profile: Profile,
  lon: number,
  lat: number,
  reach_deg: number,
  before: number | null,
): number | null {
  const narrow = Math.cos((lat * Math.PI) / 180);
  const away = (row: number) =>
    Math.hypot(((profile.lon_deg[row] as number) - lon) * narrow, (profile.lat_deg[row] as number) - lat);
  let best = -1;
  let least = Number.POSITIVE_INFINITY;
  for (let row = 0; row < profile.lon_deg.length; row += 1) {
    const distance = away(row);
    if (distance < least) {
      least = distance;
      best = row;
    }
  }
  if (least > reach_deg) return null;
  if (before === null) return best;
  let nearest = best;
  for (let row = 0; row < profile.lon_deg.length; row += 1) {
    if (Math.abs(row - before) >= Math.abs(nearest - before)) continue;
    if (away(row) <= least + 0.3 * reach_deg) nearest = row;
  }
  // Near in time to where one was: then the nearest place of that passage.
  while (nearest + 1 < profile.lon_deg.length && away(nearest + 1) < away(nearest)) nearest += 1;
  while (nearest > 0 && away(nearest - 1) < away(nearest)) nearest -= 1;
  return nearest;
}

/** Share of the distance of each kind. */
export function shares(profile: Profile, kinds: readonly Kind[]): Record<Kind, number> {
  const of: Record<Kind, number> = { matched: 0, unmatched: 0, blind: 0, contradicts: 0 };
  let all = 0;
  for (const run of runsOf(profile, (row) => kinds[row])) {
    const length = run.to_m - run.from_m;
    of[kinds[run.first] as Kind] += length;
    all += length;
  }
  if (all > 0) for (const kind of Object.keys(of) as Kind[]) of[kind] /= all;
  return of;
}
