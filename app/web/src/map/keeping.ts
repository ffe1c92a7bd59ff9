/** Which maps are kept, and the addresses that show them. */
import type { components } from "../api/schema";
import { api, got } from "../shared/api";

export type Export = components["schemas"]["Export"];

/** Whether it can be looked at as a map. */
export const isMap = (one: Export) => one.status === "done" && one.media_type === "application/vnd.pmtiles";

/** The newest that are kept. */
export async function keptMaps(signal: AbortSignal): Promise<Export[]> {
  const said = await got(api.GET("/v1/exports", { params: { query: { limit: 100 } }, signal }));
  return said.exports.filter(isMap);
}

/** The same view of another map; null: of today's. */
export function searchOf(id: string | null): string {
  const said = new URLSearchParams(location.search);
  said.delete("export");
  if (id !== null) said.set("export", id);
  const text = said.toString().replaceAll("%2F", "/").replaceAll("%2C", ",");
  return text ? `?${text}` : "";
}
