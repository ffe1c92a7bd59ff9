/** Which maps are kept, the addresses that show them, and how a style draws one; what reads them is loaded for them alone. */
import type { StyleSpecification } from "maplibre-gl";
import type { components } from "../api/schema";
import { api, got } from "../shared/api";
import type { Box } from "./state";
import { SOURCE } from "./style";

export type Export = components["schemas"]["Export"];

/** Whether it can be looked at as a map. */
export const isMap = (one: Export) => one.status === "done" && one.media_type === "application/vnd.pmtiles";

/** The newest that are kept. */
export async function keptMaps(signal: AbortSignal): Promise<Export[]> {
  const listed = await got(api.GET("/v1/exports", { params: { query: { limit: 100 } }, signal }));
  return listed.exports.filter(isMap);
}

/** The same view of another map; null: of today's. */
export function searchOf(id: string | null): string {
  const query = new URLSearchParams(location.search);
  query.delete("export");
  if (id !== null) query.set("export", id);
  const text = query.toString().replaceAll("%2F", "/").replaceAll("%2C", ",");
  return text ? `?${text}` : "";
}

export interface Kept {
  /** Of the file. */
  address: string;
  /** The moment that it shows. */
  moment: string | null;
  leastZoom: number;
  mostZoom: number;
  bbox: Box;
}

/** The style with the kept tiles in place of the service's. */
export function ofKept(style: StyleSpecification, kept: Kept | null): StyleSpecification {
  if (kept === null) return style;
  const tiles = { type: "vector", url: `pmtiles://${kept.address}` } as const;
  return { ...style, sources: { ...style.sources, [SOURCE]: tiles } };
}
