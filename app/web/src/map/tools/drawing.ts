/** A line that is drawn on the map: clicks and the space bar add points, a double click and Enter end it, Escape leaves it. */
import { signal } from "@preact/signals";
import type { Map as MapLibre, MapMouseEvent } from "maplibre-gl";
import { freeBox } from "../free";
import { type Mark, marks } from "../marks";
import { drawing } from "../shown";
import type { Position } from "../state";

/** The points so far. */
export const draft = signal<readonly Position[]>([]);
/** Two clicks so near each other are one, pixels. */
const SAME_PX = 4;

export const lineMarks = (line: readonly Position[]): Mark[] => [
  ...(line.length > 1 ? [{ kind: "line" as const, at: line }] : []),
  ...line.map((one) => ({ kind: "point" as const, at: [one] })),
];

/** The middle of what is seen of the map, where the keyboard draws. */
function aim(map: MapLibre): Position {
  const [west, south, east, north] = freeBox(map);
  return [(west + east) / 2, (south + north) / 2];
}

export function addHere(map: MapLibre): void {
  add(map, aim(map));
}

export function undo(): void {
  draft.value = draft.value.slice(0, -1);
}

function add(map: MapLibre, place: Position): void {
  const before = draft.value.at(-1);
  const near = before && map.project(before).dist(map.project(place)) < SAME_PX;
  if (!near) draft.value = [...draft.value, place];
}

/** Draw until `done`, which gets the points, or none where it was left. Whoever calls what is returned ends it as well. */
export function draw(map: MapLibre, done: (line: readonly Position[]) => void): () => void {
  let byKeys = false;
  const canvas = map.getCanvas();
  const show = () => {
    marks.value = [...lineMarks(draft.value), ...(byKeys ? [{ kind: "aim" as const, at: [aim(map)] }] : [])];
  };
  const click = (event: MapMouseEvent) => add(map, [event.lngLat.lng, event.lngLat.lat]);
  const end = () => done(draft.value.length > 1 ? draft.value : []);
  const touched = () => {
    byKeys = false;
    show();
  };
  const key = (event: KeyboardEvent) => {
    byKeys = true;
    show();
    const onMap = event.target === canvas;
    const act =
      event.key === "Escape"
        ? () => done([])
        : !onMap
          ? null
          : { Enter: end, " ": () => addHere(map), Backspace: undo }[event.key];
    if (!act) return;
    // What the keys do on the map otherwise is not meant.
    event.preventDefault();
    event.stopPropagation();
    act();
  };
  draft.value = [];
  drawing.value = true;
  canvas.style.cursor = "crosshair";
  map.doubleClickZoom.disable();
  map.on("click", click);
  map.on("dblclick", end);
  map.on("move", show);
  canvas.addEventListener("pointerdown", touched);
  document.addEventListener("keydown", key, true);
  const stop = draft.subscribe(show);
  canvas.focus({ preventScroll: true });
  return () => {
    stop();
    drawing.value = false;
    marks.value = [];
    canvas.style.cursor = "";
    map.doubleClickZoom.enable();
    map.off("click", click);
    map.off("dblclick", end);
    map.off("move", show);
    canvas.removeEventListener("pointerdown", touched);
    document.removeEventListener("keydown", key, true);
  };
}
