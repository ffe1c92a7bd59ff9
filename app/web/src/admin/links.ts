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

/** A drive's own page. */
export function drivePage(id: string): string {
  return `/drives/${id}`;
}

/** A named query, as a table for other programs unless it is said otherwise. */
export function queryAddress(name: string, values: Values = { f: "csv" }): string {
  return withQuery(`/v1/admin/${name}`, values);
}

/** The map at a place. */
export function mapAt(lon: number, lat: number, zoom: number): string {
  return `/map#${zoom.toFixed(1)}/${lat.toFixed(5)}/${lon.toFixed(5)}`;
}

/** The map with a segment opened. */
export function mapOfSegment(id: number): string {
  return `/map#segment=${id}`;
}

/** The map so that a box fills it, about. */
export function mapOfBox(box: Bounds): string {
  const [west, south, east, north] = box;
  const width = east >= west ? east - west : east + 360 - west;
  const span = Math.max(width, (north - south) * 1.5, 1e-4);
  const lon = west + width / 2;
  return mapAt(lon > 180 ? lon - 360 : lon, (south + north) / 2, Math.min(16, Math.log2(720 / span)));
}

/** The box of a tile that is named z/x/y. */
export function boxOfTile(tile: string): Bounds {
  const [z = 0, x = 0, y = 0] = tile.split("/").map(Number);
  const n = 2 ** z;
  const lat = (row: number) => (Math.atan(Math.sinh(Math.PI * (1 - (2 * row) / n))) * 180) / Math.PI;
  return [(x / n) * 360 - 180, lat(y + 1), ((x + 1) / n) * 360 - 180, lat(y)];
}

/** An address of this service that it told us itself; null for all others. */
export function ownAddress(told: string | null | undefined): string | null {
  if (!told) return null;
  try {
    const address = new URL(told, location.origin);
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
