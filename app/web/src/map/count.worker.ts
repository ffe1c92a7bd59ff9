/** Counts beside the page, so that nobody waits for it: reads the tiles that the browser has kept for the map. */
import { VectorTile } from "@mapbox/vector-tile";
import { PbfReader } from "pbf";
import { type Asked, counted, type Roads } from "./count";
import { acrossOf, downOf, type Tile } from "./tiles";

type Wanted = Asked["tiles"][number];

const MOST_TILES = 200;
const cache = new Map<string, Roads>();

function read(data: ArrayBuffer): Roads {
  const layer = Object.values(new VectorTile(new PbfReader(data)).layers)[0];
  const n = layer?.length ?? 0;
  const roads: Roads = {
    ids: new Float64Array(n),
    slope: new Float32Array(n),
    sigma: new Float32Array(n),
    drives: new Float32Array(n),
    modelled: new Float32Array(n),
    boxes: new Float32Array(4 * n),
  };
  for (let row = 0; row < n; row += 1) {
    const feature = layer?.feature(row);
    if (!feature) continue;
    const properties = feature.properties;
    const value = (name: string) => (typeof properties[name] === "number" ? properties[name] : Number.NaN);
    roads.ids[row] = feature.id ?? -row;
    roads.slope[row] = value("slope_percent");
    roads.sigma[row] = value("slope_sigma_percent");
    roads.drives[row] = value("drives");
    roads.modelled[row] = value("dem_slope_percent");
    const box = [
      Number.POSITIVE_INFINITY,
      Number.POSITIVE_INFINITY,
      Number.NEGATIVE_INFINITY,
      Number.NEGATIVE_INFINITY,
    ];
    for (const ring of feature.loadGeometry())
      for (const { x, y } of ring) {
        box[0] = Math.min(box[0] as number, x);
        box[1] = Math.min(box[1] as number, y);
        box[2] = Math.max(box[2] as number, x);
        box[3] = Math.max(box[3] as number, y);
      }
    roads.boxes.set(
      box.map((one) => one / feature.extent),
      4 * row,
    );
  }
  return roads;
}

let archives: Promise<(tile: Tile) => Promise<ArrayBuffer>> | null = null;

async function fromArchive(address: string, tile: Tile): Promise<ArrayBuffer> {
  archives ??= import("pmtiles").then(({ PMTiles }) => {
    const archive = new PMTiles(address);
    return async ({ z, x, y }) => (await archive.getZxy(z, x, y))?.data ?? new ArrayBuffer(0);
  });
  return (await archives)(tile);
}

async function fromService(url: string): Promise<ArrayBuffer> {
  // The map has just fetched it: whatever age it may have, that is what is drawn.
  const answer = await fetch(url, { cache: "force-cache" });
  if (!answer.ok) throw new Error(`${answer.status}`);
  return answer.arrayBuffer();
}

async function roadsOf({ url, tile }: Wanted, archive: string | null): Promise<Roads> {
  const cached = cache.get(url);
  if (cached) {
    cache.delete(url);
    cache.set(url, cached);
    return cached;
  }
  const roads = read(await (archive === null ? fromService(url) : fromArchive(archive, tile)));
  cache.set(url, roads);
  for (const oldest of cache.keys()) {
    if (cache.size <= MOST_TILES) break;
    cache.delete(oldest);
  }
  return roads;
}

let newest = 0;

self.onmessage = async ({ data: asked }: MessageEvent<Asked>) => {
  newest = asked.number;
  for (const url of asked.anew) cache.delete(url);
  try {
    const parts = await Promise.all(
      asked.tiles.map(async (one) => ({ tile: one.tile, roads: await roadsOf(one, asked.archive) })),
    );
    if (newest !== asked.number) return;
    const [west, south, east, north] = asked.box;
    const place = ({ z, x, y }: Tile) => {
      const side = 2 ** z;
      return [
        acrossOf(west) * side - x,
        downOf(north) * side - y,
        acrossOf(east) * side - x,
        downOf(south) * side - y,
      ] as [number, number, number, number];
    };
    self.postMessage(counted(asked, parts, place));
  } catch {
    // A tile that cannot be had is not drawn either, and the map says why: the next view counts again.
  }
};
