/** What the page of a drive shows: each part of it reads from here, and `load.ts` writes. */
import { computed, signal } from "@preact/signals";
import { search } from "../shared/address";
import { chartLink } from "../shared/chart/lines";
import type { Drive, DriveSegment, Profile, Sensor, Trial } from "./data";
import { type Kind, kindsOf } from "./stretches";

/** What is shown beside the drive: another one, or a trial of it. */
export interface Other {
  kind: "drive" | "trial";
  id: string;
  name: string;
  profile: Profile;
  segments: DriveSegment[];
}

/** What the address asks to be shown beside the drive. */
export const wanted = computed(() => {
  const asked = new URLSearchParams(search.value);
  const [trial, drive] = [asked.get("trial"), asked.get("with")];
  if (trial) return { kind: "trial" as const, id: trial };
  return drive ? { kind: "drive" as const, id: drive } : null;
});
export const drive = signal<Drive | null>(null);
/** The drive was removed while the page was open. */
export const removed = signal(false);
export const problem = signal<unknown>(null);
export const profile = signal<Profile | null>(null);
/** The same with every row, once it is there: what the map draws, and charts that are looked at closely. */
export const fullProfile = signal<Profile | null>(null);
export const segments = signal<DriveSegment[]>([]);
export const sensors = signal<Sensor[]>([]);
export const trials = signal<Trial[]>([]);
export const other = signal<Other | null>(null);
/** Part of the map to be shown: west, south, east, north. */
export const wantedBounds = signal<[number, number, number, number] | null>(null);

/** The cursor and the zoom that charts and map share; metres along the drive. */
export const link = chartLink();

export const rejected = computed(
  () => new Set(segments.value.filter((one) => one.properties.accepted === false).map((one) => one.id)),
);
/** Before there is one, the log by itself is shown: its way and its heights alone. */
export const hasResult = computed(() => drive.value?.report != null);
export const kinds = computed(() => kindsNow(profile.value));
export const fullKinds = computed(() => kindsNow(fullProfile.value));
export const segmentById = computed(() => new Map(segments.value.map((one) => [one.id, one])));

function kindsNow(shown: Profile | null): Kind[] {
  if (!shown) return [];
  // Before there is a result nothing of it is off the roads.
  if (!hasResult.value) return shown.segment_id.map(() => "matched");
  return kindsOf(shown, rejected.value);
}
