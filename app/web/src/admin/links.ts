/** Addresses that figures lead to. */
import type { Bounds } from "./types";

type Values = Record<string, string | number | boolean | null | undefined>;

function withQuery(path: string, values: Values): string {
  const query = new URLSearchParams();
  for (const [name, value] of Object.entries(values))
    if (value !== null && value !== undefined && value !== "") query.set(name, String(value));
  const text = query.toString();
  return text ? `${path}?${text}` : path;
}

/** The list of drives, narrowed. */
export function drivesPage(values: Values = {}): string {
  return withQuery("/drives", values);
}

/** When the first of so many days began, the last of which is today, in UTC as the service counts. */
export function firstMoment(count: number): string {
  return `${new Date(Date.now() - (count - 1) * 86_400_000).toISOString().slice(0, 10)}T00:00:00Z`;
}

/** A drive's own page. */
export function drivePage(id: string): string {
  return `/drives/${id}`;
}

/** A named query, as a table for other programs unless it is said otherwise. */
export function queryAddress(name: string, values: Values = { f: "csv" }): string {
  return withQuery(`/v1/admin/${name}`, values);
}

/** The map with a segment opened. */
export function mapOfSegment(id: number): string {
  return `/map?segment=${id}`;
}

/** The map so that a box fills it, perhaps with other colours. */
export function mapOfBox(box: Bounds, colour: "steepness" | "difference" = "steepness"): string {
  const bbox = box.map((degrees) => Number(degrees.toFixed(5))).join(",");
  return `/map?bbox=${bbox}${colour === "steepness" ? "" : `&colour=${colour}`}`;
}

/** The box of a tile that is named z/x/y. */
export function boxOfTile(tile: string): Bounds {
  const [z = 0, x = 0, y = 0] = tile.split("/").map(Number);
  const n = 2 ** z;
  const lat = (row: number) => (Math.atan(Math.sinh(Math.PI * (1 - (2 * row) / n))) * 180) / Math.PI;
  return [(x / n) * 360 - 180, lat(y + 1), ((x + 1) / n) * 360 - 180, lat(y)];
}

/** An address of this service that it told us itself; null for all others. */
export function ownAddress(text: string | null | undefined): string | null {
  if (!text) return null;
  try {
    const address = new URL(text, location.origin);
    if (address.protocol !== "http:" && address.protocol !== "https:") return null;
    return address.host === location.host ? address.pathname + address.search + address.hash : null;
  } catch {
    return null;
  }
}

export { withQuery };

/** The roads of a class, as a list; of them those that were driven. */
export function roadsOf(highway: string, driven: boolean): string {
  const filter = `highway = '${highway.replaceAll("'", "''")}'${driven ? " AND drives > 0" : ""}`;
  return withQuery("/collections/segments/items", { filter });
}
