/** The map itself: MapLibre with the state's style, and what clicks and keys on it do. */
import {
  AttributionControl,
  Map as MapLibre,
  type MapMouseEvent,
  Marker,
  NavigationControl,
  type PointLike,
  type RequestParameters,
  ScaleControl,
  type StyleSpecification,
  setWorkerUrl,
} from "maplibre-gl";
import workerUrl from "maplibre-gl/dist/maplibre-gl-worker.mjs?url";
import "maplibre-gl/dist/maplibre-gl.css";
import "../shared/maplibre.css";
import { effect } from "@preact/signals";
import { showPointed } from "../segment/pointed";
import { getJson } from "../shared/api";
import { config } from "../shared/config";
import { creditInView } from "../shared/credit";
import { tellError } from "../shared/Messages";
import { ledToLogin } from "../shared/session";
import { t } from "../shared/texts";
import { theme } from "../shared/theme";
import { lettersOf, over } from "./background";
import type { Asked, Counted } from "./count";
import { breaksOf } from "./count";
import { cameraOf, isSeen } from "./free";
import { type Kept, ofKept } from "./keeping";
import { Freshness, stayNew, tilesInView } from "./live";
import { followMarks, marked } from "./marks";
import { nearest } from "./picking";
import { counts, drawing, legend } from "./shown";
import {
  type Box,
  background,
  choices,
  colour,
  flyTo,
  layer,
  movedBy,
  opened,
  type Place,
  type Position,
  selected,
  view,
} from "./state";
import { drawn, isRoad, type OwnStyle, ownStyle, SOURCE, showsUnknown } from "./style";
import { LEAST_ZOOM, type Tile, tileOf, tileUrl } from "./tiles";

declare global {
  interface Window {
    /** The map, for tests and for the curious. */
    versantMap?: MapLibre;
  }
}

setWorkerUrl(workerUrl);

const MOST_ZOOM = 18;
/** The style's first view is made for a window of so many pixels. */
const FIRST_PX = 768;
const MOUSE_PX = 6;
const FINGER_PX = 16;
const OWN_FONTS: ReadonlySet<string> = new Set(["DejaVu Sans"]);
const still = matchMedia("(prefers-reduced-motion: reduce)");

/** Open the map in an element, once: the service's style is there, and has a centre. */
export function openMap(
  place: HTMLElement,
  first: OwnStyle,
  firstBackground: StyleSpecification | null,
  kept: Kept | null,
): MapLibre {
  const freshness = new Freshness();
  let own = first;
  let below = firstBackground;
  const styleNow = () => {
    const roads = ofKept(drawn(own, choices(), theme.peek()), kept);
    return marked(below ? over(below, roads) : roads, theme.peek());
  };
  const map = new MapLibre({
    container: place,
    style: styleNow(),
    ...firstView(place, first.style, kept?.bbox ?? null),
    attributionControl: false,
    dragRotate: false,
    pitchWithRotate: false,
    touchPitch: false,
    maxZoom: 20,
    minZoom: 1,
    fadeDuration: 100,
    clickTolerance: 5,
    locale: {
      "Map.Title": t("map.title"),
      "NavigationControl.ZoomIn": t("map.zoom_in"),
      "NavigationControl.ZoomOut": t("map.zoom_out"),
      "AttributionControl.ToggleAttribution": t("map.attribution"),
    },
    transformRequest: (url: string, type?: string) => request(url, type, first.style.glyphs, freshness),
  });
  window.versantMap = map;
  map.touchZoomRotate.disableRotation();
  map.keyboard.disableRotation();
  // The first is the lowest: there nothing covers the scale, be the legend open or the credit long.
  map.addControl(new ScaleControl({ maxWidth: 90 }), "bottom-right");
  map.addControl(new NavigationControl({ showCompass: false }), "bottom-right");
  map.addControl(new AttributionControl({ compact: true }), "bottom-right");
  map.on("error", ({ error }) => {
    if (error instanceof DOMException && error.name === "AbortError") return;
    if (!ledToLogin(error)) tellError(error);
  });
  followState(map, (style, other) => {
    own = style;
    below = other;
    return styleNow();
  });
  const inView = () =>
    tilesInView(map, kept?.leastZoom ?? LEAST_ZOOM[layer.value], kept?.mostZoom ?? MOST_ZOOM);
  const count = counter(map, inView, kept?.address ?? null);
  if (kept === null) creditInView(map, SOURCE);
  if (kept === null) stayNew(map, freshness, inView, count.forget);
  moves(map);
  clicks(map, () => own.segmentsFrom);
  showPointed(map, Marker);
  followMarks(map);
  return map;
}

function request(
  url: string,
  type: string | undefined,
  letters: string | undefined,
  freshness: Freshness,
): RequestParameters {
  if (type === "Glyphs") return { url: lettersOf(url, letters, OWN_FONTS) ?? url };
  const tile = type === "Tile" ? tileOf(url) : null;
  if (!tile || !url.startsWith(location.origin)) return { url };
  freshness.asked(tile);
  // What the browser kept may be from before the change, however long the service lets it keep tiles.
  return freshness.any ? { url, cache: "no-cache" } : { url };
}

function firstView(place: HTMLElement, style: StyleSpecification, all: Box | null): object {
  if (opened.view) return { center: [opened.view.lon, opened.view.lat], zoom: opened.view.zoom };
  if (opened.box) return { bounds: opened.box, fitBoundsOptions: { padding: 40, maxZoom: 17 } };
  if (!style.center && all) return { bounds: all, fitBoundsOptions: { padding: 40, maxZoom: 17 } };
  const room = Math.min(place.clientWidth, 1.5 * place.clientHeight);
  const nearest = style.zoom ?? 1;
  const zoom = nearest + Math.min(0, Math.log2(Math.max(room, 100) / FIRST_PX));
  return { center: style.center ?? [0, 0], zoom: Math.max(zoom, Math.min(nearest, LEAST_ZOOM.segments)) };
}

/** Draw what the state says, whenever it says otherwise. */
function followState(
  map: MapLibre,
  styleOf: (own: OwnStyle, background: StyleSpecification | null) => StyleSpecification,
): void {
  let turn = 0;
  let begun = false;
  let sources = `${layer.peek()} ${background.peek()}`;
  effect(() => {
    const state = choices();
    const light = theme.value;
    turn += 1;
    const mine = turn;
    if (!begun) {
      begun = true;
      return;
    }
    Promise.all([ownStyle(light, state.colour, state.layer), backgroundStyle(state.background)])
      .then(([own, below]) => {
        if (mine !== turn) return;
        legend.value = own.legend;
        const wanted = `${state.layer} ${state.background}`;
        // Other tiles are another source, which cannot be changed in place.
        map.setStyle(styleOf(own, below), { diff: wanted === sources });
        sources = wanted;
      })
      .catch(tellError);
  });
}

/** Where the map is goes into the state, and others can move it. */
function moves(map: MapLibre): void {
  const tell = ({ lng, lat } = map.getCenter(), zoom = map.getZoom()) => {
    view.value = { lon: lng, lat, zoom };
  };
  const go = (place: Place, atOnce = still.matches): void => {
    const camera = cameraOf(map, place);
    if (!camera) return;
    map.stop();
    // The address says at once where the map goes: in a window that nobody sees a flight never ends.
    tell(camera.center, camera.zoom);
    if (atOnce) map.jumpTo(camera);
    else map.flyTo({ ...camera, duration: 800 });
  };
  const reveal = (box: Box, line: readonly Position[]): void => {
    if (map.isMoving()) return void map.once("moveend", () => reveal(box, line));
    const camera = cameraOf(map, { bbox: box }, true);
    if (camera && !isSeen(map, line, camera.zoom))
      map.easeTo({ ...camera, duration: still.matches ? 0 : 300 });
  };
  map.on("moveend", () => tell());
  tell();
  const waiting = movedBy({
    // A panel that opens with the same click is there in a moment, and lies over the map.
    fly: (place) => setTimeout(go, 0, place),
    back: ({ lon, lat, zoom }) => map.jumpTo({ center: [lon, lat], zoom }),
    reveal,
  });
  if (waiting) go(waiting, true);
}

/** Clicks, taps and Enter select the nearest road; from afar they lead nearer first. */
function clicks(map: MapLibre, singlesFrom: () => number): void {
  const at = (point: { x: number; y: number }, reach: number) => {
    const box: [PointLike, PointLike] = [
      [point.x - reach, point.y - reach],
      [point.x + reach, point.y + reach],
    ];
    const layers = map.getLayersOrder().filter(isRoad);
    return nearest(map.queryRenderedFeatures(box, { layers }), point, (place) => map.project(place));
  };
  const select = (point: { x: number; y: number }, reach: number) => {
    const hit = at(point, reach);
    if (layer.value === "segments" && map.getZoom() < singlesFrom()) {
      if (!hit) return;
      const { lng: lon, lat } = map.unproject([point.x, point.y]);
      map.once("moveend", () => map.once("idle", () => select(map.project([lon, lat]), FINGER_PX)));
      flyTo({ lon, lat, zoom: singlesFrom() + 1 });
      return;
    }
    selected.value = hit === null ? null : { kind: layer.value === "ways" ? "way" : "segment", id: hit };
  };
  const finger = (event: MapMouseEvent) =>
    (event.originalEvent as PointerEvent).pointerType === "touch" || !matchMedia("(pointer: fine)").matches;
  map.on("click", (event) => {
    if (!drawing.peek()) select(event.point, finger(event) ? FINGER_PX : MOUSE_PX);
  });
  map.on("mousemove", (event) => {
    if (map.isMoving() || drawing.peek()) return;
    map.getCanvas().style.cursor = at(event.point, MOUSE_PX) === null ? "" : "pointer";
  });
  map.getCanvas().addEventListener("keydown", (event) => {
    if (event.key === "Enter") select(map.project(map.getCenter()), FINGER_PX);
    if (event.key === "Escape") selected.value = null;
  });
}

/** Counts what is in view whenever the map has come to rest. */
function counter(
  map: MapLibre,
  inView: () => Tile[],
  archive: string | null,
): { forget: (tiles: Tile[]) => void } {
  const worker = new Worker(new URL("./count.worker.ts", import.meta.url), { type: "module" });
  let number = 0;
  let anew: string[] = [];
  let asked = "";
  worker.onmessage = ({ data }: MessageEvent<Counted>) => {
    if (data.number === number) counts.value = data;
  };
  const ask = () => {
    const shades = legend.value;
    if (!shades || map.isMoving() || !map.isSourceLoaded(SOURCE)) return;
    const bounds = map.getBounds();
    const state = choices();
    const question: Omit<Asked, "number"> = {
      tiles: inView().map((tile) => ({ tile, url: tileUrl(layer.value, tile) })),
      anew,
      archive,
      box: [bounds.getWest(), bounds.getSouth(), bounds.getEast(), bounds.getNorth()] as Box,
      colour: colour.value,
      breaks: breaksOf(shades.classes),
      classes: state.classes,
      mostSigma: state.mostSigma,
      leastDrives: state.leastDrives,
      unknown: showsUnknown(state),
    };
    const text = JSON.stringify(question);
    if (text === asked) return;
    asked = JSON.stringify({ ...question, anew: [] });
    anew = [];
    number += 1;
    worker.postMessage({ ...question, number } satisfies Asked);
  };
  map.on("idle", ask);
  return { forget: (tiles) => anew.push(...tiles.map((tile) => tileUrl(layer.value, tile))) };
}

const backgrounds = new Map<string, StyleSpecification>();

/** The style of a background, or of the usual one; null: there is none, or it cannot be had, which is told. */
export async function backgroundStyle(name: string | null): Promise<StyleSpecification | null> {
  const address = name === null ? config.background_style_url : config.backgrounds[name];
  if (!address) return null;
  try {
    const style = backgrounds.get(address) ?? (await getJson<StyleSpecification>(address));
    backgrounds.set(address, style);
    return style;
  } catch (error) {
    tellError(error);
    return null;
  }
}
