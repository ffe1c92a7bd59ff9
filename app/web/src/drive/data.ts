/** What the service answers about a drive, and how it is asked. */
import type { components } from "../api/schema";
import { ApiProblem, getJson } from "../shared/api";
import type { Said } from "../shared/said";

export type Drive = components["schemas"]["Drive"];
/** Whether its run has left its result, whose slopes are on their way to the map. */
export const isComputed = (drive: Drive) => drive.status === "running" && drive.stage === "publishing";
export type Report = Record<string, unknown>;
type Column = (number | null)[];

/** Columns over the distance driven, a row per epoch with a position; slopes in the direction of travel. */
export interface Profile {
  epochs: number;
  distance_m: number[];
  time: string[];
  alt_m: Column;
  alt_sigma_m: Column;
  slope_percent: Column;
  slope_sigma_percent: Column;
  grade_percent: Column;
  grade_sigma_percent: Column;
  segment_id: (number | null)[];
  forward: (boolean | null)[];
  gap: boolean[];
  has_gnss: boolean[];
  time_s: number[];
  lon_deg: number[];
  lat_deg: number[];
  dem_height_m: Column;
  ride?: Ride;
}

/** A stretch of a drive, and its mean grade in the direction of travel. */
export interface RideStretch {
  from_m: number;
  to_m: number;
  percent: number;
  sigma_percent: number | null;
  name: string | null;
}

export interface Climb extends RideStretch {
  length_m: number;
  gain_m: number;
  maximum_percent: number;
  category: string | null;
}

/** Figures of the whole drive, however few rows the profile has. */
export interface Ride {
  distance_m: number | null;
  duration_s: number | null;
  ascent_m: number | null;
  ascent_sigma_m: number | null;
  descent_m: number | null;
  descent_sigma_m: number | null;
  least_rise_m: number | null;
  steepest: RideStretch | null;
  climbs: Climb[];
}

export interface Sensor {
  name: string;
  is_height: boolean;
  along_m: number[];
  time_s: number[];
  /** Heights in metres, grades in percent. */
  value: Column;
  /** What to add to heights that refer to something else than the estimate does. */
  shift_m: number | null;
}

export interface SegmentProperties {
  osm_way_id: number;
  name: string | null;
  highway: string | null;
  length_m: number | null;
  slope_percent: number | null;
  slope_sigma_percent: number | null;
  accepted: boolean | null;
  in_network: boolean;
  combined_slope_percent: number | null;
  combined_slope_sigma_percent: number | null;
  combined_drives: number | null;
}

export interface DriveSegment {
  id: number;
  geometry: { coordinates: [number, number][] };
  properties: SegmentProperties;
}

export interface Trial {
  id: string;
  drive_id: string;
  method: string;
  options: Record<string, unknown>;
  status: string;
  progress: number;
  stage: string | null;
  failure: { kind: string; reason: string; said?: Said | null } | null;
  report: Report | null;
  created_at: string;
}

export interface Method {
  name: string;
  description?: string;
}

/** So many rows draw a profile as sharply as a wide screen shows it. */
export const POINTS = 4000;

/** The address of a drive, or of something of it. */
export function addressOf(id: string, part = ""): string {
  return `/v1/drives/${encodeURIComponent(id)}${part}`;
}

export function loadDrive(id: string): Promise<Drive> {
  return getJson<Drive>(addressOf(id));
}

/** The profile at an address, thinned to `points` rows; 0 asks for all. */
export function loadProfile(address: string, points: number): Promise<Profile> {
  return getJson<Profile>(`${address}/profile?f=json${points ? `&points=${points}` : ""}`);
}

interface Page {
  features: DriveSegment[];
  links: { rel: string; href: string }[];
}

/** Every estimate of a drive or a trial, in the order of driving. */
export async function loadSegments(address: string): Promise<DriveSegment[]> {
  const all: DriveSegment[] = [];
  let next: string | undefined = `${address}/segments`;
  while (next) {
    const page: Page = await getJson<Page>(next);
    all.push(...page.features);
    const href = page.links.find((link) => link.rel === "next")?.href;
    // The service may be known to itself by another name than to the browser.
    next = href === undefined ? undefined : address + href.slice(href.indexOf("/segments"));
  }
  return all;
}

/** What the answer holds, or `missing` where the service has no such thing. */
export async function orMissing<T>(answer: Promise<T>, missing: T): Promise<T> {
  try {
    return await answer;
  } catch (error) {
    if (error instanceof ApiProblem && error.status === 404) return missing;
    throw error;
  }
}

export async function loadSensors(address: string): Promise<Sensor[]> {
  const answer = getJson<{ sensors: Sensor[] }>(`${address}/measurements?points=${POINTS}`);
  return (await orMissing(answer, { sensors: [] })).sensors;
}

export async function loadTrials(id: string): Promise<Trial[]> {
  return (await orMissing(getJson<{ trials: Trial[] }>(addressOf(id, "/trials")), { trials: [] })).trials;
}
