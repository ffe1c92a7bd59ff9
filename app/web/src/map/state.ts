/** What the map shows and what is chosen on it: signals that the panel and the search read and set. */
import { signal } from "@preact/signals";

export type Selected = { kind: "segment" | "way"; id: number };
export type Target = { lon: number; lat: number; zoom?: number } | { bbox: [number, number, number, number] };

export const selected = signal<Selected | null>(null);
export const view = signal({ lon: 0, lat: 0, zoom: 1 });

/** Where the map is to go. */
export const flight = signal<Target | null>(null);

export function flyTo(target: Target): void {
  flight.value = target;
}
