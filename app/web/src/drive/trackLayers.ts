/** A drive's track as GeoJSON, and how it is drawn over the service's roads. */
import type { StyleSpecification } from "maplibre-gl";
import type { Theme } from "../shared/theme";
import type { Profile, RideStretch } from "./data";
import { type Kind, rowAt, runsOf } from "./stretches";

export const TRACK = "drive-track";
export const STRETCH = "drive-stretch";
const OTHER = "drive-other";
const ROADS = 0.3;

export const KINDS: Kind[] = ["matched", "blind", "unmatched", "contradicts"];
const COLOURS: Record<Theme, Record<Kind | "case" | "other" | "stretch", string>> = {
  light: {
    matched: "#1d5fd1",
    blind: "#5a6663",
    unmatched: "#a3261d",
    contradicts: "#a04e00",
    case: "#ffffff",
    other: "#8a2f8f",
    stretch: "#d4a900",
  },
  dark: {
    matched: "#8ab6ff",
    blind: "#a3b0ac",
    unmatched: "#ff9b90",
    contradicts: "#f0a050",
    case: "#121615",
    other: "#e29be6",
    stretch: "#ffd84d",
  },
};
const WIDTHS: Record<Kind, number> = { matched: 3, blind: 3, unmatched: 3, contradicts: 6 };
/** Kinds differ by more than their colour. */
const DASHES: Partial<Record<Kind, number[]>> = { blind: [0.4, 1.6], unmatched: [2, 1.2] };

export interface Lines {
  type: "FeatureCollection";
  features: {
    type: "Feature";
    properties: { kind: Kind };
    geometry: { type: "MultiLineString"; coordinates: [number, number][][] };
  }[];
}

/** The track, one feature for each kind of row. */
export function trackLines(profile: Profile, kinds: readonly Kind[]): Lines {
  const of = new Map<Kind, [number, number][][]>();
  const at = (row: number): [number, number] => [
    profile.lon_deg[row] as number,
    profile.lat_deg[row] as number,
  ];
  for (const run of runsOf(profile, (row) => kinds[row])) {
    // To the first row of the next run, so that the line goes through.
    const joined = run.last + 1 < kinds.length && !profile.gap[run.last + 1];
    const line: [number, number][] = [];
    for (let row = run.first; row <= run.last + (joined ? 1 : 0); row += 1) line.push(at(row));
    if (line.length < 2) continue;
    const kind = kinds[run.first] as Kind;
    const lines = of.get(kind);
    if (lines) lines.push(line);
    else of.set(kind, [line]);
  }
  return {
    type: "FeatureCollection",
    features: [...of].map(([kind, coordinates]) => ({
      type: "Feature",
      properties: { kind },
      geometry: { type: "MultiLineString", coordinates },
    })),
  };
}

/** The part of the track that stands out, or nothing. */
export function partLine(profile: Profile, part: RideStretch | null) {
  const [first, last] = part
    ? [rowAt(profile.distance_m, part.from_m), rowAt(profile.distance_m, part.to_m) + 1]
    : [0, 0];
  const coordinates = profile.lon_deg
    .slice(first, last)
    .map((lon, n): [number, number] => [lon, profile.lat_deg[first + n] as number]);
  return {
    type: "Feature" as const,
    properties: {},
    geometry: { type: "LineString" as const, coordinates },
  };
}

/** West, south, east, north of rows of a profile. */
export function boundsOf(
  profile: Profile,
  first = 0,
  last = profile.lon_deg.length - 1,
): [number, number, number, number] {
  const box: [number, number, number, number] = [180, 90, -180, -90];
  for (let row = first; row <= last; row += 1) {
    const lon = profile.lon_deg[row] as number;
    const lat = profile.lat_deg[row] as number;
    box[0] = Math.min(box[0], lon);
    box[1] = Math.min(box[1], lat);
    box[2] = Math.max(box[2], lon);
    box[3] = Math.max(box[3], lat);
  }
  return box;
}

/** The service's style with its roads faded, and the track over them. */
export function withTrack(
  style: StyleSpecification,
  colours: Theme,
  track: Lines,
  other: Lines | null,
  part: ReturnType<typeof partLine>,
): StyleSpecification {
  const palette = COLOURS[colours];
  const faded = style.layers.map((layer) => {
    if (layer.type === "line") return { ...layer, paint: { ...layer.paint, "line-opacity": ROADS } };
    if (layer.type === "symbol")
      return { ...layer, paint: { ...layer.paint, "text-opacity": 0.6, "icon-opacity": ROADS } };
    return layer;
  });
  const layout = { "line-cap": "round", "line-join": "round" } as const;
  const lines = KINDS.map((kind) => ({
    id: `${TRACK}-${kind}`,
    type: "line" as const,
    source: TRACK,
    filter: ["==", ["get", "kind"], kind] as ["==", ["get", string], string],
    layout: DASHES[kind] ? { "line-join": "round" as const } : layout,
    paint: {
      "line-color": palette[kind],
      "line-width": WIDTHS[kind],
      ...(DASHES[kind] ? { "line-dasharray": DASHES[kind] } : {}),
    },
  }));
  return {
    ...style,
    sources: {
      ...style.sources,
      [TRACK]: { type: "geojson", data: track },
      [STRETCH]: { type: "geojson", data: part },
      ...(other ? { [OTHER]: { type: "geojson", data: other } } : {}),
    },
    layers: [
      ...faded,
      ...(other
        ? [
            {
              id: OTHER,
              type: "line" as const,
              source: OTHER,
              layout,
              paint: { "line-color": palette.other, "line-width": 2, "line-offset": 5 },
            },
          ]
        : []),
      {
        id: STRETCH,
        type: "line",
        source: STRETCH,
        layout,
        paint: { "line-color": palette.stretch, "line-width": 15 },
      },
      {
        id: `${TRACK}-case`,
        type: "line",
        source: TRACK,
        layout,
        paint: { "line-color": palette.case, "line-width": 7, "line-opacity": 0.8 },
      },
      ...lines,
    ],
  } as StyleSpecification;
}
