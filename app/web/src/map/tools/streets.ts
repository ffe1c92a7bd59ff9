/** Streets out of segments: a whole way over a hill is level on the mean, its segments are not. */
import type { Position, Segment } from "../../segment/data";

export interface Street {
  key: string;
  name: string | null;
  highway: string;
  /** Its steepest segment. */
  id: number;
  steepness_percent: number;
  sigma_percent: number;
  length_m: number;
  line: Position[];
}

const MOST = 20;
/** A slope of fewer sigmas may as well be none: such roads would lead every list. */
const LEAST_SIGMAS = 3;

/** One of each name, or of each way without one, by its first segment: the steepest come first. */
export function streetsOf(segments: readonly Segment[]): Street[] {
  const streets = new Map<string, Street>();
  for (const { id, properties: of, geometry } of segments) {
    const steepness = Math.abs(of.slope_percent ?? 0);
    const sigma = of.slope_sigma_percent ?? Number.POSITIVE_INFINITY;
    const key = of.name ?? `way ${of.osm_way_id}`;
    if (steepness < LEAST_SIGMAS * sigma || streets.has(key)) continue;
    streets.set(key, {
      key,
      name: of.name,
      highway: of.highway,
      id,
      steepness_percent: steepness,
      sigma_percent: sigma,
      length_m: of.length_m,
      line: geometry.coordinates,
    });
  }
  return [...streets.values()].slice(0, MOST);
}
