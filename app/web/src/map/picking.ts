/** Which of the roads near a point is meant. */

interface Point {
  x: number;
  y: number;
}
interface Road {
  id?: string | number | undefined;
  geometry: GeoJSON.Geometry;
}

/** The id of the road nearest to a point of the screen; `project` brings its line there. */
export function nearest(
  roads: Road[],
  at: Point,
  project: (place: [number, number]) => Point,
): number | null {
  let nearest: number | null = null;
  let least = Number.POSITIVE_INFINITY;
  for (const { id, geometry } of roads) {
    if (typeof id !== "number") continue;
    for (const line of linesOf(geometry)) {
      const points = line.map((place) => project(place as [number, number]));
      for (let k = 1; k < points.length; k += 1) {
        const away = distance(at, points[k - 1] as Point, points[k] as Point);
        if (away < least) [least, nearest] = [away, id];
      }
    }
  }
  return nearest;
}

function linesOf(geometry: GeoJSON.Geometry): GeoJSON.Position[][] {
  if (geometry.type === "LineString") return [geometry.coordinates];
  return geometry.type === "MultiLineString" ? geometry.coordinates : [];
}

/** Of a point from the stretch between two others. */
export function distance(at: Point, from: Point, to: Point): number {
  const [dx, dy] = [to.x - from.x, to.y - from.y];
  const along = ((at.x - from.x) * dx + (at.y - from.y) * dy) / Math.max(dx * dx + dy * dy, 1e-12);
  const share = Math.min(1, Math.max(0, along));
  return Math.hypot(at.x - from.x - share * dx, at.y - from.y - share * dy);
}
