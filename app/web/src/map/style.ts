/** The service's own style, and what this page makes of it: filters, what is selected, a background. */
import type {
  ExpressionSpecification,
  FilterSpecification,
  LayerSpecification,
  StyleSpecification,
} from "maplibre-gl";
import { getJson } from "../shared/api";
import type { Theme } from "../shared/theme";
import type { Class, Colour, LayerName, Selection, State } from "./state";

export interface LegendClass {
  colour: string;
  from_percent: number;
  to_percent: number | null;
}
export interface Legend {
  classes: LegendClass[];
  unknown: string;
  known: ExpressionSpecification;
  value: ExpressionSpecification;
}
export interface OwnStyle {
  style: StyleSpecification;
  legend: Legend;
  segmentsFrom: number;
}

export const SOURCE = "slopes";
/** Of what has a name: waters below the roads, labels above them. */
export const NAMES = "names";
const styles = new Map<string, Promise<OwnStyle>>();

/** The style of these choices; asked for once. */
export function ownStyle(theme: Theme, colour: Colour, layer: LayerName): Promise<OwnStyle> {
  const query = `theme=${theme}&colour=${colour}&layer=${layer}`;
  let pending = styles.get(query);
  if (!pending) {
    pending = getJson<StyleSpecification>(`/style.json?${query}`).then((style) => {
      const metadata = style.metadata as Record<string, unknown>;
      return {
        style,
        legend: metadata["versant:legend"] as Legend,
        segmentsFrom: metadata["versant:segments_from_zoom"] as number,
      };
    });
    styles.set(query, pending);
    pending.catch(() => styles.delete(query));
  }
  return pending;
}

/** The same, asked for anew: where the map is to be opened may have changed. */
export function freshStyle(theme: Theme, colour: Colour, layer: LayerName): Promise<OwnStyle> {
  styles.clear();
  return ownStyle(theme, colour, layer);
}

/** Whether a road passes the sliders. */
export function sliders(state: Pick<State, "mostSigma" | "leastDrives">): ExpressionSpecification[] {
  const conditions: ExpressionSpecification[] = [];
  if (state.mostSigma !== null)
    conditions.push(["<=", ["coalesce", ["get", "slope_sigma_percent"], 1e9], state.mostSigma]);
  if (state.leastDrives > 0) conditions.push([">=", ["coalesce", ["get", "drives"], 0], state.leastDrives]);
  return conditions;
}

function inClasses(legend: Legend, classes: readonly Class[]): ExpressionSpecification[] {
  if (!classes.length) return [];
  const each = classes.flatMap((one): ExpressionSpecification[] => {
    const step = typeof one === "number" ? legend.classes[one] : undefined;
    if (!step) return [];
    const low: ExpressionSpecification = [">=", legend.value, step.from_percent];
    return [step.to_percent === null ? low : ["all", low, ["<", legend.value, step.to_percent]]];
  });
  return [["any", ...each] as ExpressionSpecification];
}

/** Whether roads without a figure are among what is shown. */
export function showsUnknown(state: Pick<State, "classes" | "mostSigma" | "leastDrives">): boolean {
  if (state.classes.length) return state.classes.includes("unknown");
  return state.mostSigma === null && state.leastDrives === 0;
}

/** Whether anything is hidden. */
export function filters(state: Pick<State, "classes" | "mostSigma" | "leastDrives">): boolean {
  return state.classes.length > 0 || state.mostSigma !== null || state.leastDrives > 0;
}

const QUIET = { light: "#dcdedb", dark: "#2b3237" } as const;
const CHOSEN = { light: "#d6006e", dark: "#ff5fb0" } as const;
/** Round what is selected; no slope has that colour. */
const HALO_PX: ExpressionSpecification = [
  "interpolate",
  ["exponential", 1.5],
  ["zoom"],
  10,
  6,
  14,
  12,
  19,
  34,
];

function line(id: string, tiles: LayerName, filter: FilterSpecification, paint: object): LayerSpecification {
  return {
    id,
    type: "line",
    source: SOURCE,
    "source-layer": tiles,
    filter,
    layout: { "line-cap": "round", "line-join": "round" },
    paint,
  } as LayerSpecification;
}

/** The style that is drawn: the service's, with what is filtered left as a thin line, and a halo round the selected. */
export function drawn(own: OwnStyle, state: State, theme: Theme): StyleSpecification {
  const { legend } = own;
  const passing = [...inClasses(legend, state.classes), ...sliders(state)];
  const unknown = showsUnknown(state);
  const lowest = own.style.layers.findIndex((one) => "source" in one && one.source === SOURCE);
  const restyled = own.style.layers.slice(lowest).map((one): LayerSpecification => {
    if ((!passing.length && unknown) || ("source" in one && one.source === NAMES)) return one;
    const base = (one as { filter?: ExpressionSpecification }).filter ?? true;
    const known: unknown = ["all", ...passing];
    const passes = /^unknown-|-unknown$/.test(one.id)
      ? unknown
      : one.id === "tunnel"
        ? ["case", legend.known, known, unknown]
        : known;
    return { ...one, filter: ["all", base, passes] } as LayerSpecification;
  });
  const others = filters(state)
    ? [line("filtered", state.layer, ["boolean", true], { "line-color": QUIET[theme], "line-width": 0.8 })]
    : [];
  const halo = line("selected", state.layer, isSelected(state.selected, state.layer), {
    "line-color": CHOSEN[theme],
    "line-width": HALO_PX,
  });
  return { ...own.style, layers: [...own.style.layers.slice(0, lowest), ...others, halo, ...restyled] };
}

function isSelected(selected: Selection | null, layer: LayerName): FilterSpecification {
  const here = selected !== null && `${selected.kind}s` === layer;
  return here ? ["==", ["id"], selected.id] : ["boolean", false];
}

/** Layers that a click looks for, the roads themselves. */
export const isRoad = (id: string) => id.startsWith("slope-") || id.startsWith("unknown-");
