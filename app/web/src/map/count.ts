/** How many roads of each class are in view: what the page asks of the counting worker, and what comes back. */
import type { Box, Class, Colour } from "./state";
import type { LegendClass } from "./style";
import type { Tile } from "./tiles";

export interface Asked {
  number: number;
  tiles: { url: string; tile: Tile }[];
  /** What was fetched of these before is old. */
  anew: string[];
  /** The PMTiles that hold the tiles; null: their addresses do. */
  archive: string | null;
  box: Box;
  colour: Colour;
  breaks: number[];
  classes: readonly Class[];
  mostSigma: number | null;
  leastDrives: number;
  unknown: boolean;
}

export interface Counted {
  number: number;
  all: number;
  shown: number;
  /** By class of the legend: what is in view and passes the sliders. */
  each: number[];
  unknown: number;
  /** How many were measured, whatever is shown. */
  measured: number;
}

/** Of one tile: a row for each road; NaN is unknown. */
export interface Roads {
  ids: Float64Array;
  slope: Float32Array;
  sigma: Float32Array;
  drives: Float32Array;
  modelled: Float32Array;
  /** West, north, east, south of each, shares of the tile. */
  boxes: Float32Array;
}

export const breaksOf = (classes: LegendClass[]) => classes.map((one) => one.from_percent);

/** The figure that a colour stands for; NaN: unknown. */
export function figure(colour: Colour, roads: Roads, row: number): number {
  const slope = roads.slope[row] as number;
  const modelled = roads.modelled[row] as number;
  switch (colour) {
    case "steepness":
      return Math.abs(slope);
    case "elevation-model":
      return Math.abs(modelled);
    case "difference":
      return Math.abs(slope - modelled);
    case "certainty": {
      const sigma = roads.sigma[row] as number;
      return Number.isNaN(slope) ? Number.NaN : Number.isNaN(sigma) ? 3 : sigma;
    }
  }
}

/** Count what is in view; a road in several tiles is one. */
export function counted(
  asked: Asked,
  parts: { tile: Tile; roads: Roads }[],
  place: (tile: Tile) => Box,
): Counted {
  const result: Counted = {
    number: asked.number,
    all: 0,
    shown: 0,
    each: asked.breaks.map(() => 0),
    unknown: 0,
    measured: 0,
  };
  const seen = new Set<number>();
  for (const { tile, roads } of parts) {
    const [west, north, east, south] = place(tile);
    for (let row = 0; row < roads.ids.length; row += 1) {
      const at = 4 * row;
      const { boxes } = roads;
      const outside =
        (boxes[at] as number) > east ||
        (boxes[at + 1] as number) > south ||
        (boxes[at + 2] as number) < west ||
        (boxes[at + 3] as number) < north;
      const id = roads.ids[row] as number;
      if (outside || seen.has(id)) continue;
      seen.add(id);
      add(result, asked, roads, row);
    }
  }
  return result;
}

function add(result: Counted, asked: Asked, roads: Roads, row: number): void {
  result.all += 1;
  if (!Number.isNaN(roads.slope[row] as number)) result.measured += 1;
  const value = figure(asked.colour, roads, row);
  if (Number.isNaN(value)) {
    result.unknown += 1;
    if (asked.unknown) result.shown += 1;
    return;
  }
  const sigma = roads.sigma[row] as number;
  if (asked.mostSigma !== null && !(sigma <= asked.mostSigma)) return;
  if ((roads.drives[row] as number) < asked.leastDrives) return;
  let index = asked.breaks.length - 1;
  while (index > 0 && value < (asked.breaks[index] as number)) index -= 1;
  result.each[index] = (result.each[index] as number) + 1;
  if (!asked.classes.length || asked.classes.includes(index)) result.shown += 1;
}
