/** What the canvas tells the page: the legend that is drawn, and what of it is in view. */
import { signal } from "@preact/signals";
import type { Counted } from "./count";
import type { Legend } from "./style";

export const legend = signal<Legend | null>(null);
export const counts = signal<Counted | null>(null);
/** From this zoom on single segments are drawn. */
export const segmentsFrom = signal(13);
