/** Which tiles there are in a view, and what is in one: arithmetic of Web Mercator, nothing of the page. */
import type { Box, LayerName } from "./state";

export interface Tile {
  z: number;
  x: number;
  y: number;
}

/** Farther out nothing is drawn of a layer. */
export const LEAST_ZOOM = { segments: 6, ways: 10 } as const;

export const keyOf = (one: Tile) => `${one.z}/${one.x}/${one.y}`;
/** Of a tile's width: as far as lines go beyond its edge, and a little. */
const MARGIN = 0.02;

export const acrossOf = (lon: number) => (lon + 180) / 360;

export function downOf(lat: number): number {
  const bounded = Math.min(85.06, Math.max(-85.06, lat)) * (Math.PI / 180);
  return 0.5 - Math.asinh(Math.tan(bounded)) / (2 * Math.PI);
}

/** The tiles of a zoom that meet a box, by `margin` of their width more. */
export function tilesOver(box: Box, z: number, margin = 0): Tile[] {
  const side = 2 ** z;
  const tiles: Tile[] = [];
  const last = (at: number) => Math.min(side - 1, Math.floor(at * side + margin));
  const first = (at: number) => Math.max(0, Math.floor(at * side - margin));
  for (let x = first(acrossOf(box[0])); x <= last(acrossOf(box[2])); x += 1)
    for (let y = first(downOf(box[3])); y <= last(downOf(box[1])); y += 1) tiles.push({ z, x, y });
  return tiles;
}

/** Whether a change in the box can be seen in the tile; null: it may be anywhere. */
export function shows(tile: Tile, box: Box | null): boolean {
  if (box === null) return true;
  const side = 2 ** tile.z;
  return (
    acrossOf(box[0]) * side <= tile.x + 1 + MARGIN &&
    acrossOf(box[2]) * side >= tile.x - MARGIN &&
    downOf(box[3]) * side <= tile.y + 1 + MARGIN &&
    downOf(box[1]) * side >= tile.y - MARGIN
  );
}

/** The address of a tile, as the style's tiles have it. */
export function tileUrl(layer: LayerName, { z, x, y }: Tile): string {
  return layer === "ways"
    ? `/collections/ways/tiles/WebMercatorQuad/${z}/${y}/${x}.mvt`
    : `/tiles/${z}/${x}/${y}.mvt`;
}

/** The tile of an address; null: it is none. */
export function tileOf(url: string): Tile | null {
  const xyz = /\/tiles\/(\d+)\/(\d+)\/(\d+)\.mvt/.exec(url);
  if (xyz) return { z: Number(xyz[1]), x: Number(xyz[2]), y: Number(xyz[3]) };
  const ogc = /\/tiles\/WebMercatorQuad\/(\d+)\/(\d+)\/(\d+)\.mvt/.exec(url);
  return ogc ? { z: Number(ogc[1]), x: Number(ogc[3]), y: Number(ogc[2]) } : null;
}
