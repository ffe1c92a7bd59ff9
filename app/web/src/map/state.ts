/**
 * What the map shows, and its address, by the rule of `shared/address.ts`.
 *
 * `?at=14.2/49.41/8.69&colour=difference&layer=ways&classes=5,8,unknown&sigma=0.5&drives=2&segment=17`; what is as usual
 * is left out. `background=` names one of the backgrounds that the operator offers. Others lead here by `?segment=17`,
 * `?way=3`, `?at=` or `?bbox=west,south,east,north`. `export=` names a kept map that is shown in place of today's, `tool=`
 * what is open besides, `line=` the line whose profile that shows.
 */
import { batch, effect, signal } from "@preact/signals";
import { goTo, search as query } from "../shared/address";
import { config } from "../shared/config";

export type Colour = "steepness" | "elevation-model" | "difference" | "certainty";
export const COLOURS: readonly Colour[] = ["steepness", "elevation-model", "difference", "certainty"];
export type LayerName = "segments" | "ways";
export type Class = number | "unknown";
export interface Selection {
  kind: "segment" | "way";
  id: number;
}
export interface View {
  lon: number;
  lat: number;
  zoom: number;
}
export type Box = [west: number, south: number, east: number, north: number];
export type Position = [lon: number, lat: number];
export type Place = { lon: number; lat: number; zoom?: number } | { bbox: Box };

export const TOOLS = ["steepest", "profile", "export", "inclines"] as const;
export type ToolName = (typeof TOOLS)[number];

/** The tool that is open; what is looked at lies over it. */
export const tool = signal<ToolName | null>(null);
/** The line whose profile is shown, as a polyline (`tools/polyline.ts`); nothing: none that the address can keep. */
export const line = signal("");
/** The segment or way that is looked at. */
export const selected = signal<Selection | null>(null);
/** Where the map is; null until it is open. */
export const view = signal<View | null>(null);
export const colour = signal<Colour>("steepness");
export const layer = signal<LayerName>("segments");
/** Classes of the legend that are shown, by number; none: all. */
export const classes = signal<readonly Class[]>([]);
/** The largest sigma that is shown, percent; null: any. */
export const mostSigma = signal<number | null>(null);
/** The least number of drives that is shown. */
export const leastDrives = signal(0);

/** Of the backgrounds that may be chosen the name of one; null: the usual one. */
export const background = signal<string | null>(null);

/** The elevation model's slope is known of segments alone. */
export const ofSegmentsOnly = (one: Colour) => one === "elevation-model" || one === "difference";

export interface State {
  view: View | null;
  box: Box | null;
  selected: Selection | null;
  colour: Colour;
  layer: LayerName;
  classes: readonly Class[];
  mostSigma: number | null;
  leastDrives: number;
  tool: ToolName | null;
  line: string;
  background: string | null;
}

function numbers(text: string | null, separator: string, count: number): number[] | null {
  const numbers = text?.split(separator).map((one) => (one === "" ? Number.NaN : Number(one))) ?? [];
  return numbers.length === count && numbers.every(Number.isFinite) ? numbers : null;
}

function wholeNumber(text: string | null): number | null {
  return text !== null && /^[0-9]{1,15}$/.test(text) ? Number(text) : null;
}

/** What an address says; what is no sense in it is as usual. */
export function parsed(search: string): State {
  const asked = new URLSearchParams(search);
  const at = numbers(asked.get("at"), "/", 3);
  const box = numbers(asked.get("bbox"), ",", 4);
  const segment = wholeNumber(asked.get("segment"));
  const way = wholeNumber(asked.get("way"));
  const layerAsked: LayerName =
    asked.get("layer") === "ways" || (way !== null && !asked.has("layer")) ? "ways" : "segments";
  const colourAsked = COLOURS.find((one) => one === asked.get("colour")) ?? "steepness";
  const sigma = Number(asked.get("sigma") ?? Number.NaN);
  return {
    view:
      at && Math.abs(at[1] as number) <= 90
        ? { zoom: at[0] as number, lat: at[1] as number, lon: at[2] as number }
        : null,
    box: box as Box | null,
    selected:
      segment !== null ? { kind: "segment", id: segment } : way !== null ? { kind: "way", id: way } : null,
    colour: layerAsked === "ways" && ofSegmentsOnly(colourAsked) ? "steepness" : colourAsked,
    layer: layerAsked,
    classes: (asked.get("classes") ?? "")
      .split(",")
      .map((one) => (one === "unknown" ? one : wholeNumber(one)))
      .filter((one): one is Class => one !== null),
    mostSigma: sigma > 0 && Number.isFinite(sigma) ? sigma : null,
    leastDrives: wholeNumber(asked.get("drives")) ?? 0,
    tool: TOOLS.find((one) => one === asked.get("tool")) ?? null,
    line: asked.get("tool") === "profile" ? (asked.get("line") ?? "") : "",
    background: Object.keys(config.backgrounds).find((one) => one === asked.get("background")) ?? null,
  };
}

const OWN = [
  "at",
  "bbox",
  "segment",
  "way",
  "colour",
  "layer",
  "classes",
  "sigma",
  "drives",
  "tool",
  "line",
  "background",
];

/** The address of a state; what others have in it stays. */
export function address(state: State, search: string): string {
  const query = new URLSearchParams(search);
  for (const name of OWN) query.delete(name);
  const at = state.view;
  if (at) query.set("at", `${at.zoom.toFixed(2)}/${at.lat.toFixed(5)}/${at.lon.toFixed(5)}`);
  if (state.selected) query.set(state.selected.kind, String(state.selected.id));
  if (state.colour !== "steepness") query.set("colour", state.colour);
  if (state.layer !== (state.selected?.kind === "way" ? "ways" : "segments")) query.set("layer", state.layer);
  if (state.classes.length) query.set("classes", state.classes.join(","));
  if (state.mostSigma !== null) query.set("sigma", String(state.mostSigma));
  if (state.leastDrives) query.set("drives", String(state.leastDrives));
  if (state.tool) query.set("tool", state.tool);
  if (state.tool === "profile" && state.line) query.set("line", state.line);
  if (state.background) query.set("background", state.background);
  const text = query.toString().replaceAll("%2F", "/").replaceAll("%2C", ",");
  return text ? `?${text}` : "";
}

/** The export that an address asks for in place of today's map. */
export function keptOf(search: string): string | null {
  const query = new URLSearchParams(search).get("export") ?? "";
  return /^[0-9a-f]{8}(-[0-9a-f]{4}){3}-[0-9a-f]{12}$/i.test(query) ? query : null;
}

/** What the address said when the page was opened. */
export const keptId = keptOf(location.search);
export const opened = parsed(location.search);
apply(opened);

function apply(state: State): void {
  selected.value = state.selected;
  colour.value = state.colour;
  // Ways are not among the tiles that are kept.
  layer.value = keptId === null ? state.layer : "segments";
  classes.value = state.classes;
  mostSigma.value = state.mostSigma;
  leastDrives.value = state.leastDrives;
  tool.value = state.tool;
  line.value = state.line;
  background.value = state.background;
}

/** The state as it is, but for where the map is. */
export function choices(): State {
  return {
    view: null,
    box: null,
    selected: selected.value,
    colour: colour.value,
    layer: layer.value,
    classes: classes.value,
    mostSigma: mostSigma.value,
    leastDrives: leastDrives.value,
    tool: tool.value,
    line: line.value,
    background: background.value,
  };
}

/** The state as it is. */
export const present = (): State => ({ ...choices(), view: view.value });

// A place was chosen, and the map is on its way there.
let placeChosen = false;

/** Keep the address up to date, and show what it says whenever Back, Forward or a link changed it. */
export function keepAddress(): void {
  let before: string | null = null;
  let waiting = false;
  const write = () => {
    waiting = false;
    const now = present();
    if (now.view === null) return;
    const chosen = address(choices(), "");
    const entry = before !== null && (placeChosen || chosen !== before);
    before = chosen;
    placeChosen = false;
    goTo(location.pathname + address(now, location.search), !entry);
  };
  effect(() => {
    present();
    // All that one click changes is one step.
    if (!waiting) queueMicrotask(write);
    waiting = true;
  });
  let opening = true;
  query.subscribe((text) => {
    const state = parsed(text);
    if (opening || address(state, "") === address(present(), "")) return;
    batch(() => apply(state));
    before = address(choices(), "");
    if (state.view) moves?.back(state.view);
  });
  opening = false;
}

interface Moves {
  /** Fly to a place that is then seen. */
  fly: (place: Place) => void;
  /** Be where it was. */
  back: (view: View) => void;
  /** Move where something lies over the line, around which the box is. */
  reveal: (box: Box, line: readonly Position[]) => void;
}
let moves: Moves | null = null;
let waiting: Place | null = null;
// What was selected before the map was open.
let unrevealed: { box: Box; line: readonly Position[] } | null = null;
// A link names what is selected, and not where it is.
let unplaced = opened.selected !== null && opened.view === null && opened.box === null;

/** Show a place that somebody chose. */
export function flyTo(place: Place): void {
  placeChosen = moves !== null;
  fly(place);
}

/** Show a line that was selected; `far` away it is flown to. */
export function showSelected(box: Box, line: readonly Position[], far = false): void {
  if (far || unplaced) fly({ bbox: box });
  else if (moves) moves.reveal(box, line);
  else unrevealed = { box, line };
}

function fly(place: Place): void {
  unplaced = false;
  if (moves) moves.fly(place);
  else waiting = place;
}

/** The map is open and moves so; where it was to go meanwhile. */
export function movedBy(how: Moves): Place | null {
  moves = how;
  if (unrevealed) how.reveal(unrevealed.box, unrevealed.line);
  return waiting;
}
