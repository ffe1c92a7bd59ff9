/** What a chart shows, and how its values are written. Knows nothing of how it is drawn. */
import { signal } from "@preact/signals";
import { distance, moment, number, UNKNOWN } from "../format";
import { ownForm } from "../texts";

/** Colours that a line can have, by what it says; each has a value for light and for dark ground in chart.css. */
export type ChartColour = "measured" | "model" | "other" | "fourth" | "quiet" | "danger" | "climb";

/** One value for each place of the chart; null and NaN are unknown, and leave a gap. */
export type Values = ArrayLike<number | null | undefined>;

export interface Line {
  label: string;
  values: Values;
  /** One standard deviation of each value: a band, or error bars of points. */
  sigma?: Values;
  colour: ChartColour;
  unit?: string;
  decimals?: number;
  dashed?: boolean;
  /** Dots instead of a line. */
  points?: boolean;
  /** How wide dots are, pixels: many of them want small ones. */
  dot?: number;
  /** Its scale: the left one, or one of its own on the right. */
  axis?: "left" | "right";
  /** Not drawn until the visitor asks for it. */
  hidden?: boolean;
}

/** What the horizontal axis counts: metres, seconds since a start, or seconds since 1970, of moments or of days of UTC. */
export type Axis = "distance" | "elapsed" | "moment" | "day";

/** A stretch of the horizontal axis that stands out. */
export interface Stretch {
  from: number;
  to: number;
  colour: ChartColour;
  /** Written at its upper end. */
  label?: string;
  /** Drawn more strongly than others. */
  strong?: boolean;
}

/** What several charts of the same axis share: where the cursor is, and what is zoomed to. */
export function chartLink() {
  return { at: signal<number | null>(null), range: signal<[number, number] | null>(null) };
}
export type ChartLink = ReturnType<typeof chartLink>;

/** The value at a place, or null where it is unknown. */
export function known(values: Values | undefined, index: number): number | null {
  const value = values?.[index];
  return value === null || value === undefined || !Number.isFinite(value) ? null : value;
}

/** A line's value at a place with its sigma and unit. */
export function written(line: Line, index: number): string {
  const value = known(line.values, index);
  if (value === null) return UNKNOWN;
  const decimals = line.decimals ?? 1;
  const sigma = known(line.sigma, index);
  const doubt = sigma === null ? "" : ` ± ${number(sigma, decimals)}`;
  return `${number(value, decimals)}${doubt}${line.unit ? ` ${line.unit}` : ""}`;
}

/** Hours, minutes and seconds since a start. */
export function elapsed(seconds: number): string {
  const whole = Math.round(seconds);
  const two = (part: number) => String(part).padStart(2, "0");
  return `${Math.floor(whole / 3600)}:${two(Math.floor(whole / 60) % 60)}:${two(whole % 60)}`;
}

/** A place of the horizontal axis, in full. */
export function place(axis: Axis, x: number): string {
  if (axis === "distance") return x < 100 ? `${number(x, 1)} m` : distanceFull(x);
  if (axis === "day") return dayOf(x, { dateStyle: "medium" });
  return axis === "elapsed" ? elapsed(x) : moment(new Date(x * 1000).toISOString());
}

/** A day of UTC: it has no hours, whatever the visitor's time zone. */
function dayOf(x: number, style: Intl.DateTimeFormatOptions): string {
  return new Date(x * 1000).toLocaleDateString(ownForm(navigator.languages), { timeZone: "UTC", ...style });
}

function distanceFull(metres: number): string {
  return metres < 10_000 ? `${number(metres)} m` : `${number(metres / 1000, 2)} km`;
}

/** How many decimals tell ticks of such a step apart, and none of them wrong. */
export function decimalsOf(step: number): number {
  const exact = [0, 1, 2, 3].find((decimals) => {
    const whole = step * 10 ** decimals;
    return Math.abs(whole - Math.round(whole)) < 1e-6 * Math.max(whole, 1) && Math.round(whole) > 0;
  });
  return exact ?? 3;
}

/** What stands at the ticks of the horizontal axis. */
export function ticks(axis: Axis, splits: number[], span: number): string[] {
  if (axis === "elapsed") return splits.map(elapsed);
  if (axis === "distance") {
    const step = (splits[1] ?? 1) - (splits[0] ?? 0);
    if ((splits.at(-1) ?? 0) < 1000 || step < 100)
      return splits.map((x) => `${number(x, decimalsOf(step))} m`);
    return splits.map((x) => (x === 0 ? distance(0) : `${number(x / 1000, decimalsOf(step / 1000))} km`));
  }
  const day = 86_400;
  const style: Intl.DateTimeFormatOptions =
    span < 2 * day && axis === "moment"
      ? { hour: "2-digit", minute: "2-digit" }
      : span < 300 * day
        ? { day: "numeric", month: "short" }
        : { month: "short", year: "numeric" };
  if (axis === "day") return splits.map((x) => dayOf(x, style));
  const format = new Intl.DateTimeFormat(ownForm(navigator.languages), style);
  return splits.map((x) => format.format(new Date(x * 1000)));
}

/** The place in ascending `x` that is nearest to a value. */
export function nearest(x: ArrayLike<number>, value: number): number {
  let low = 0;
  let high = x.length - 1;
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if ((x[middle] as number) <= value) low = middle;
    else high = middle;
  }
  const after = Math.abs((x[high] ?? 0) - value) < Math.abs((x[low] ?? 0) - value);
  return after ? high : low;
}

/** Evenly taken places of a range, both ends among them: rows of a table that people can still read. */
export function spread(first: number, last: number, most: number): number[] {
  const count = Math.min(most, last - first + 1);
  if (count <= 1) return count === 1 ? [first] : [];
  return Array.from({ length: count }, (_, n) => Math.round(first + ((last - first) * n) / (count - 1)));
}
