/** What tools draw over the roads: a line, its points, a street that is pointed at. */
import { effect, signal } from "@preact/signals";
import type { GeoJSONSource, LayerSpecification, Map as MapLibre, StyleSpecification } from "maplibre-gl";
import type { Theme } from "../shared/theme";
import type { Position } from "./state";

export interface Mark {
  kind: "line" | "street" | "point" | "aim";
  at: readonly Position[];
}
export const marks = signal<readonly Mark[]>([]);

const MARKS = "marks";
const COLOURS = {
  light: ["#1d5fd1", "#d6006e", "#ffffff"],
  dark: ["#8ab6ff", "#ff5fb0", "#10151a"],
} as const;

function features(): GeoJSON.FeatureCollection {
  return {
    type: "FeatureCollection",
    features: marks.peek().map(({ kind, at }) => ({
      type: "Feature",
      properties: { kind },
      geometry:
        kind === "line" || kind === "street"
          ? { type: "LineString", coordinates: at as Position[] }
          : { type: "Point", coordinates: at[0] as Position },
    })),
  };
}

/** The style with the marks on top of it. */
export function marked(style: StyleSpecification, theme: Theme): StyleSpecification {
  const [own, street, rim] = COLOURS[theme];
  const line = (id: string, colour: unknown, width: number) =>
    ({
      id: `${MARKS}-${id}`,
      type: "line",
      source: MARKS,
      filter: ["==", ["geometry-type"], "LineString"],
      layout: { "line-cap": "round", "line-join": "round" },
      paint: { "line-color": colour, "line-width": width },
    }) as LayerSpecification;
  const points = {
    id: `${MARKS}-points`,
    type: "circle",
    source: MARKS,
    filter: ["==", ["geometry-type"], "Point"],
    paint: {
      "circle-radius": ["match", ["get", "kind"], "aim", 12, 5],
      "circle-color": own,
      "circle-opacity": ["match", ["get", "kind"], "aim", 0.15, 1],
      "circle-stroke-color": ["match", ["get", "kind"], "aim", own, rim],
      "circle-stroke-width": 2,
    },
  } as LayerSpecification;
  const colour = ["match", ["get", "kind"], "street", street, own];
  return {
    ...style,
    sources: { ...style.sources, [MARKS]: { type: "geojson", data: features() } },
    layers: [...style.layers, line("rim", rim, 8), line("line", colour, 4), points],
  };
}

/** Draw them as they are, also where the style became another one meanwhile. */
export function followMarks(map: MapLibre): void {
  const draw = () => (map.getSource(MARKS) as GeoJSONSource | undefined)?.setData(features());
  effect(() => {
    if (marks.value) draw();
  });
  map.on("style.load", draw);
}
