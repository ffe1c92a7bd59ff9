import type { Position } from "../state";

const RADIUS_M = 6_371_008.8;

/** Metres along a line, on a sphere. */
export function lengthOf(points: readonly Position[]): number {
  const rad = Math.PI / 180;
  return points.slice(1).reduce((sum, [lon, lat], n) => {
    const [lon0, lat0] = points[n] as Position;
    const a =
      Math.sin(((lat - lat0) * rad) / 2) ** 2 +
      Math.cos(lat * rad) * Math.cos(lat0 * rad) * Math.sin(((lon - lon0) * rad) / 2) ** 2;
    return sum + 2 * RADIUS_M * Math.asin(Math.sqrt(a));
  }, 0);
}
