/** The part of the map that nothing lies over: where what is chosen is shown. */
import { LngLat, type Map as MapLibre } from "maplibre-gl";
import type { Box, Place, Position } from "./state";

interface Camera {
  center: LngLat;
  zoom: number;
}
interface Sides {
  top: number;
  right: number;
  bottom: number;
  left: number;
}

/** Pixels between what is shown and what lies over the map. */
const MARGIN_PX = 24;
const NEAREST = 17;

/** Pixels from each side of the map that something lies over, with a margin. */
function covered(map: MapLibre): Sides {
  const all = map.getContainer().getBoundingClientRect();
  const sides = { top: 0, right: 0, bottom: 0, left: 0 };
  for (const one of document.querySelectorAll(".panel, .map-side > *")) {
    const box = one.getBoundingClientRect();
    if (box.width === 0) continue;
    const isColumn = box.width < all.width / 2 || box.height / all.height > box.width / all.width;
    if (isColumn && box.left - all.left < all.right - box.right)
      sides.left = Math.max(sides.left, box.right - all.left);
    else if (isColumn) sides.right = Math.max(sides.right, all.right - box.left);
    else if (box.top - all.top < all.bottom - box.bottom)
      sides.top = Math.max(sides.top, box.bottom - all.top);
    else sides.bottom = Math.max(sides.bottom, all.bottom - box.top);
  }
  // Where nothing at all is free it does not matter what lies where.
  if (sides.left + sides.right + 3 * MARGIN_PX > all.width) sides.left = sides.right = 0;
  if (sides.top + sides.bottom + 3 * MARGIN_PX > all.height) sides.top = sides.bottom = 0;
  return {
    top: sides.top + MARGIN_PX,
    right: sides.right + MARGIN_PX,
    bottom: sides.bottom + MARGIN_PX,
    left: sides.left + MARGIN_PX,
  };
}

/** What is seen of the map, degrees, and all that the window has of it. */
export function freeBox(map: MapLibre): Box {
  const { top, right, bottom, left } = covered(map);
  const { clientWidth, clientHeight } = map.getContainer();
  const [northWest, southEast] = [
    map.unproject([left - MARGIN_PX, top - MARGIN_PX]),
    map.unproject([clientWidth - right + MARGIN_PX, clientHeight - bottom + MARGIN_PX]),
  ];
  return onEarth(northWest.lng, southEast.lat, southEast.lng, northWest.lat);
}

export function wholeBox(map: MapLibre): Box {
  const all = map.getBounds();
  return onEarth(all.getWest(), all.getSouth(), all.getEast(), all.getNorth());
}

/** Maps go on round the Earth; west > east is across the antimeridian. */
function onEarth(west: number, south: number, east: number, north: number): Box {
  const wrapped = (lon: number) => ((((lon + 180) % 360) + 360) % 360) - 180;
  const bounded = (lat: number) => Math.min(90, Math.max(-90, lat));
  if (east - west >= 360) return [-180, bounded(south), 180, bounded(north)];
  return [wrapped(west), bounded(south), wrapped(east), bounded(north)];
}

/** With the place in the middle of what is free, perhaps no nearer than the map is now. */
export function cameraOf(map: MapLibre, place: Place, noNearer = false): Camera | null {
  const padding = covered(map);
  const bounds: Box = "bbox" in place ? place.bbox : [place.lon, place.lat, place.lon, place.lat];
  const nearest = "bbox" in place ? NEAREST : (place.zoom ?? map.getZoom());
  const camera = map.cameraForBounds(bounds, { padding, maxZoom: noNearer ? map.getZoom() : nearest });
  if (camera?.center === undefined || camera.zoom === undefined) return null;
  return { center: LngLat.convert(camera.center), zoom: camera.zoom };
}

/** Whether a line is in what is free: all of it, or some of it where all of it would fit from farther alone. */
export function isSeen(map: MapLibre, line: readonly Position[], fitsFrom: number): boolean {
  const { top, right, bottom, left } = covered(map);
  const { clientWidth, clientHeight } = map.getContainer();
  const seen = line
    .map((one) => map.project(one))
    .map(({ x, y }) => x >= left && x <= clientWidth - right && y >= top && y <= clientHeight - bottom);
  return fitsFrom < map.getZoom() ? seen.includes(true) : !seen.includes(false);
}
