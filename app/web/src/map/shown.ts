/** What the canvas tells the page: the legend that is drawn, and what of it is in view. */
import { signal } from "@preact/signals";
import type { Map as MapLibre } from "maplibre-gl";
import type { Counted } from "./count";
import type { Kept } from "./keeping";
import type { Legend } from "./style";

export const legend = signal<Legend | null>(null);
export const counts = signal<Counted | null>(null);
/** The kept map that is shown; null: today's. */
export const kept = signal<Kept | null>(null);
/** From this zoom on single segments are drawn. */
export const segmentsFrom = signal(13);
/** The map, once it is open. */
export const shownMap = signal<MapLibre | null>(null);
/** Whether clicks draw a line, and select nothing. */
export const drawing = signal(false);
/** How often something in view has changed since the page was opened. */
export const changes = signal(0);
