/** A dot on the map where the panel points at. */
import { effect } from "@preact/signals";
import type { Map as MapLibre, Marker } from "maplibre-gl";
import { pointedPlace } from "./data";

export function showPointed(map: MapLibre, Dot: typeof Marker): void {
  const element = document.createElement("div");
  element.className = "pointed";
  const dot = new Dot({ element });
  effect(() => {
    const place = pointedPlace.value;
    if (place) dot.setLngLat([place.lon, place.lat]).addTo(map);
    else dot.remove();
  });
}
