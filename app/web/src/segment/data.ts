/** What the API says of segments, ways and the drives behind them. */
import { signal } from "@preact/signals";
import type { components } from "../api/schema";
import { getJson } from "../shared/api";

export type Position = [number, number];
export type Observation = components["schemas"]["Observation"];
export type Profile = components["schemas"]["SegmentProfile"];
type Link = { href: string; rel: string };

export interface SegmentProperties {
  id: number;
  osm_way_id: number;
  from_node: number;
  to_node: number;
  length_m: number;
  highway: string;
  name: string | null;
  oneway: number;
  bridge: boolean;
  tunnel: boolean;
  slope_percent: number | null;
  slope_sigma_percent: number | null;
  drives: number;
  observations: number;
  dem_slope_percent: number | null;
  updated_at: string | null;
  height_from_m: number | null;
  height_to_m: number | null;
  height_sigma_m: number | null;
  steepest_percent: number | null;
  steepest_from_m: number | null;
  steepest_to_m: number | null;
  driven_share: number | null;
}

export interface WayProperties {
  id: number;
  osm_way_id: number;
  segments: number;
  length_m: number;
  highway: string;
  name: string | null;
  oneway: number;
  bridge: boolean;
  tunnel: boolean;
  slope_percent: number | null;
  slope_sigma_percent: number | null;
  drives: number;
  dem_slope_percent: number | null;
  steepest_percent: number | null;
  steepest_from_m: number | null;
  steepest_to_m: number | null;
  measured_share: number;
  updated_at: string | null;
}

export interface Feature<P> {
  id: number;
  geometry: { coordinates: Position[] };
  properties: P;
}
export type Segment = Feature<SegmentProperties>;
export type Way = Feature<WayProperties>;
interface Page<P> {
  features: Feature<P>[];
  links: Link[];
}

/** The place that a list or a chart points at; the map shows it (pointed.ts). */
export const pointedPlace = signal<{ lon: number; lat: number } | null>(null);

const ITEMS = "/collections/segments/items";
const WAYS = "/collections/ways/items";
const PER_PAGE = 50;

export const segmentAddress = (id: number) => `/v1/segments/${id}`;

/** The segment; a gap between driven ones comes with the slope that follows. */
export const loadSegment = (id: number, signal: AbortSignal) =>
  getJson<Segment>(`${segmentAddress(id)}?gaps=true`, signal);

export const loadProfile = (id: number, signal: AbortSignal) =>
  getJson<Profile>(`${segmentAddress(id)}/profile?gaps=true`, signal);

export interface ObservationPage {
  observations: Observation[];
  next: string | null;
}

/** The drives behind a segment: the first page, or the one at the address that the last page named. */
export async function loadObservations(
  id: number,
  at: string | null,
  signal: AbortSignal,
): Promise<ObservationPage> {
  const page = await getJson<{ observations: Observation[]; links: Link[] }>(
    at ?? `${segmentAddress(id)}/observations?limit=${PER_PAGE}`,
    signal,
  );
  return { observations: page.observations, next: next(page.links) };
}

export const loadWay = (id: number, signal: AbortSignal) => getJson<Way>(`${WAYS}/${id}`, signal);

export interface SegmentPage {
  segments: Segment[];
  next: string | null;
}

/** The segments of an OpenStreetMap way, page by page. */
export async function loadSegmentsOf(
  osmWay: number,
  at: string | null,
  signal: AbortSignal,
): Promise<SegmentPage> {
  const page = await getJson<Page<SegmentProperties>>(
    at ?? `${ITEMS}?osm_way_id=${osmWay}&gaps=true&limit=${PER_PAGE}`,
    signal,
  );
  return { segments: page.features, next: next(page.links) };
}

/** The ways of that number: several where an extract's edge cuts one. */
export async function waysOf(osmWay: number, signal: AbortSignal): Promise<Way[]> {
  return (await getJson<Page<WayProperties>>(`${WAYS}?osm_way_id=${osmWay}&limit=20`, signal)).features;
}

/** Of several ways the one that goes through a place; else the first. */
export function wayThrough(ways: readonly Way[], place: Position): Way | undefined {
  const same = ([lon, lat]: Position) => Math.abs(lon - place[0]) < 2e-7 && Math.abs(lat - place[1]) < 2e-7;
  return ways.find((one) => one.geometry.coordinates.some(same)) ?? ways[0];
}

/** Segments by a filter that an index answers. */
export async function segmentsWhere(filter: string, limit: number, signal: AbortSignal): Promise<Segment[]> {
  const query = new URLSearchParams({ filter, limit: String(limit), sortby: "name" });
  return (await getJson<Page<SegmentProperties>>(`${ITEMS}?${query}`, signal)).features;
}

/** Links lead where the page came from, whatever name the service knows itself by. */
function next(links: readonly Link[]): string | null {
  const href = links.find((one) => one.rel === "next")?.href;
  if (href === undefined) return null;
  const address = new URL(href, location.origin);
  return address.pathname + address.search;
}

/** The middle between a line's ends. */
export function middleOf({ geometry }: Feature<unknown>): { lon: number; lat: number } | null {
  const [from, to] = [geometry.coordinates[0], geometry.coordinates.at(-1)];
  return from && to ? { lon: (from[0] + to[0]) / 2, lat: (from[1] + to[1]) / 2 } : null;
}

/** The box around lines. */
export function boxOf(features: readonly Feature<unknown>[]): [number, number, number, number] {
  const all = features.flatMap((one) => one.geometry.coordinates);
  const lon = all.map((one) => one[0]);
  const lat = all.map((one) => one[1]);
  return [Math.min(...lon), Math.min(...lat), Math.max(...lon), Math.max(...lat)];
}
