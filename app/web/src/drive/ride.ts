/** What is looked at of a ride: a climb or its steepest stretch, chosen (which the address says) or pointed at. */
import { computed, effect, signal } from "@preact/signals";
import { goTo, search } from "../shared/address";
import type { Stretch } from "../shared/chart/lines";
import { t } from "../shared/texts";
import type { Climb, Profile, RideStretch } from "./data";
import { fullProfile, link, profile, wantedBounds } from "./state";
import { rowAt } from "./stretches";
import { boundsOf } from "./trackLayers";

const STEEPEST = "steepest";
/** Of its own length, shown to either side of what is chosen. */
const AROUND = 0.15;

export const ride = computed(() => profile.value?.ride ?? null);

/** The stretch of that name: `steepest`, or the number of a climb. */
function stretchOf(name: string | null): RideStretch | null {
  if (name === STEEPEST) return ride.value?.steepest ?? null;
  return (name !== null && /^[1-9]\d*$/.test(name) && ride.value?.climbs[Number(name) - 1]) || null;
}

/** The name of what is chosen; null: nothing, or something that the ride has not. */
export const chosen = computed(() => {
  const asked = new URLSearchParams(search.value).get("stretch");
  return stretchOf(asked) ? asked : null;
});
/** The name of what the pointer or the keyboard is at. */
const pointed = signal<string | null>(null);
/** What the map makes stand out. */
export const highlighted = computed(() => stretchOf(pointed.value ?? chosen.value));

export const nameOf = (climb: Climb | null) =>
  climb === null ? STEEPEST : String((ride.peek()?.climbs.indexOf(climb) ?? -1) + 1);

/** Choose a stretch, or take the choice back. */
export function choose(name: string | null): void {
  const here = new URL(location.href);
  if (name === null) here.searchParams.delete("stretch");
  else here.searchParams.set("stretch", name);
  goTo(here.href);
}

/** The pointer or the keyboard is at a stretch, or at none: map and charts show where it is. */
export function point(name: string | null): void {
  pointed.value = name;
  const one = stretchOf(name);
  link.at.value = one && (one.from_m + one.to_m) / 2;
}

/** Charts and map show what is chosen; where nothing is, all. */
export function showChosen(): void {
  const rows = fullProfile.peek() ?? profile.peek();
  const along = rows?.distance_m;
  if (!rows || !along?.length) return;
  const one = stretchOf(chosen.peek());
  const spare = one ? AROUND * (one.to_m - one.from_m) : 0;
  link.range.value = one && [
    Math.max(along[0] as number, one.from_m - spare),
    Math.min(along[along.length - 1] as number, one.to_m + spare),
  ];
  wantedBounds.value = one
    ? boundsOf(rows, rowAt(along, one.from_m), rowAt(along, one.to_m))
    : boundsOf(rows);
}

let before: string | null = null;
effect(() => {
  const now = chosen.value;
  if (now !== before) showChosen();
  before = now;
});

/** Climbs, and the steepest stretch while it is chosen, as charts mark them. */
export function marked(of: Profile, name: string | null): Stretch[] {
  const mark = (one: RideStretch, label: string, strong: boolean): Stretch => ({
    from: one.from_m,
    to: one.to_m,
    colour: "climb",
    label,
    strong,
  });
  const climbs = (of.ride?.climbs ?? []).map((one, n) =>
    mark(one, `▲${one.category ?? ""}`, name === String(n + 1)),
  );
  const steepest = name === STEEPEST && of.ride?.steepest;
  return steepest ? [...climbs, mark(steepest, t("drive.ride.steepest_mark"), true)] : climbs;
}
