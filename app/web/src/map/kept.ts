/** A kept map instead of today's: an export as PMTiles, of which only what is looked at is fetched (`/map?export=ID`). */
import { addProtocol } from "maplibre-gl";
import { PMTiles, Protocol } from "pmtiles";
import { ApiProblem, api, got } from "../shared/api";
import { t } from "../shared/texts";
import { isMap, type Kept } from "./keeping";

/** Make the export's tiles known to the map; throws where it is gone, not done, or holds no tiles. */
export async function openKept(id: string): Promise<Kept> {
  const exported = await got(api.GET("/v1/exports/{export_id}", { params: { path: { export_id: id } } }));
  if (!isMap(exported)) {
    const why = t("map.kept_not", { name: exported.file_name });
    throw new ApiProblem(409, why, why);
  }
  const address = `${location.origin}/v1/exports/${id}/file`;
  const archive = new PMTiles(address);
  const head = await archive.getHeader();
  const protocol = new Protocol({ metadata: true });
  protocol.add(archive);
  addProtocol("pmtiles", protocol.tile);
  return {
    address,
    moment: exported.started_at,
    leastZoom: head.minZoom,
    mostZoom: head.maxZoom,
    bbox: [head.minLon, head.minLat, head.maxLon, head.maxLat],
  };
}
