/** Lines out of files: GPX and GeoJSON, read where the file lies. It is sent to nobody, its line alone is. */
import { ApiProblem } from "../../shared/api";
import { spread } from "../../shared/chart/lines";
import { t } from "../../shared/texts";
import type { Position } from "../state";

export const MOST_BYTES = 30e6;
/** More places are thinned. */
export const MOST_PLACES = 5000;

export interface FileLine {
  name: string;
  points: Position[];
  /** Places in the file. */
  all: number;
}

/** The line of a file; an `ApiProblem` whose message says why there is none. */
export async function lineOf(file: File): Promise<FileLine> {
  if (file.size > MOST_BYTES)
    throw problem(t("tools.profile.large", { name: file.name, n: MOST_BYTES / 1e6 }));
  const text = await file.text();
  const places = (text.trimStart().startsWith("{") ? ofGeoJson(text) : ofGpx(text)).filter(isOnEarth);
  if (places.length < 2) throw problem(t("tools.profile.no_line_in", { name: file.name }));
  const kept = spread(0, places.length - 1, MOST_PLACES).map((n) => places[n] as Position);
  return { name: file.name, points: kept, all: places.length };
}

const problem = (why: string) => new ApiProblem(0, why, why);
const isOnEarth = ([lon, lat]: Position) => Math.abs(lon) <= 180 && Math.abs(lat) <= 90;

function ofGpx(text: string): Position[] {
  const document = new DOMParser().parseFromString(text, "application/xml");
  const named = (name: string) => [...document.getElementsByTagNameNS("*", name)];
  const track = named("trkpt");
  return (track.length > 0 ? track : named("rtept")).map((one) => [
    Number.parseFloat(one.getAttribute("lon") ?? ""),
    Number.parseFloat(one.getAttribute("lat") ?? ""),
  ]);
}

function ofGeoJson(text: string): Position[] {
  try {
    return lines(JSON.parse(text)).map(([lon, lat]) => [lon ?? Number.NaN, lat ?? Number.NaN]);
  } catch {
    return [];
  }
}

/** The places of all lines in a GeoJSON object, in their order. */
function lines(one: GeoJSON.GeoJSON | null): GeoJSON.Position[] {
  switch (one?.type) {
    case "FeatureCollection":
      return one.features.flatMap(lines);
    case "Feature":
      return lines(one.geometry);
    case "GeometryCollection":
      return one.geometries.flatMap(lines);
    case "LineString":
      return one.coordinates;
    case "MultiLineString":
      return one.coordinates.flat();
    default:
      return [];
  }
}
