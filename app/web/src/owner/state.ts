/** One owner: the caller's, or for operators the one that the address names; and the receipt of a removal. */
import { signal } from "@preact/signals";
import type { components } from "../api/schema";
import { api, got } from "../shared/api";

export type Figures = components["schemas"]["OwnerFigures"];
export type Receipt = components["schemas"]["OwnerRemoval"];
type Feature = components["schemas"]["ZoneFeature"];

/** A zone as its fields have it: what is typed may be no number yet. */
export interface Zone {
  /** Of the row, as long as the page is open. */
  key: number;
  name: string;
  lat: string;
  lon: string;
  radius: string;
}

const asked = new URLSearchParams(location.search);
/** Of another owner, for operators; null: the caller's own. */
export const otherId = Number(asked.get("owner")) || null;
/** Of a receipt that is shown in the place of an owner. */
export const removalId = asked.get("removal");

export const figures = signal<Figures | null>(null);
/** Null: they are not known, or another owner's, which nobody sees. */
export const zones = signal<Zone[] | null>(null);
export const receipt = signal<Receipt | null>(null);
export const problem = signal<unknown>(null);

const PATH = otherId === null ? null : { params: { path: { owner_id: otherId } } };
/** Where the archive is fetched. */
export const ARCHIVE = otherId === null ? "/v1/owner/archive" : `/v1/owners/${otherId}/archive`;

let lastKey = 0;

export function newZone(name = "", lat = "", lon = "", radius = "300"): Zone {
  lastKey += 1;
  return { key: lastKey, name, lat, lon, radius };
}

/** Zones as the service takes them. */
export function featuresOf(all: readonly Zone[]): Feature[] {
  return all.map((zone) => ({
    type: "Feature",
    geometry: { type: "Point", coordinates: [Number(zone.lon), Number(zone.lat)] },
    properties: { name: zone.name.trim(), radius_m: Number(zone.radius) },
  }));
}

/** As the answer has it. */
interface Given {
  geometry: { coordinates: readonly number[] };
  properties: { name: string; radius_m: number };
}

export function zonesOf(features: readonly Given[]): Zone[] {
  return features.map(({ geometry, properties }) => {
    const [lon, lat] = geometry.coordinates;
    return newZone(properties.name, String(lat), String(lon), String(properties.radius_m));
  });
}

export async function load(): Promise<void> {
  problem.value = null;
  try {
    if (removalId !== null) {
      const params = { path: { removal_id: removalId } };
      receipt.value = await got(api.GET("/v1/removals/{removal_id}", { params }));
    } else if (PATH !== null) {
      figures.value = await got(api.GET("/v1/owners/{owner_id}", PATH));
    } else {
      const both = [got(api.GET("/v1/owner")), got(api.GET("/v1/owner/zones"))] as const;
      const [own, known] = await Promise.all(both);
      figures.value = own;
      zones.value = zonesOf(known.features);
    }
  } catch (error) {
    problem.value = error;
  }
}

export async function saveKeeping(days: number | null): Promise<void> {
  const body = { keep_logs_days: days };
  figures.value = await got(
    PATH === null ? api.PATCH("/v1/owner", { body }) : api.PATCH("/v1/owners/{owner_id}", { ...PATH, body }),
  );
}

export async function saveZones(): Promise<void> {
  const body = { type: "FeatureCollection" as const, features: featuresOf(zones.value ?? []) };
  await got(api.PUT("/v1/owner/zones", { body }));
}

/** Remove it; the way to the receipt, which needs no key: there is none any more. */
export async function removeOwner(name: string): Promise<string> {
  const query = { name };
  const begun = await got(
    PATH === null
      ? api.DELETE("/v1/owner", { params: { query } })
      : api.DELETE("/v1/owners/{owner_id}", { params: { ...PATH.params, query } }),
  );
  return `/owner?${new URLSearchParams({ removal: begun.id })}`;
}
