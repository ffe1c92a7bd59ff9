/** What figures of slopes mean, in words. */
import { number, percent, UNKNOWN } from "../shared/format";
import { hasText, t } from "../shared/texts";
import type { Position } from "./data";

const POINTS = ["n", "ne", "e", "se", "s", "sw", "w", "nw"] as const;
export type Compass = (typeof POINTS)[number];

/** The point of the compass that a line's end lies at, seen from its beginning. */
export function compass(from: Position, to: Position): Compass {
  let east = to[0] - from[0];
  if (east > 180) east -= 360;
  if (east < -180) east += 360;
  const eastward = east * Math.cos((from[1] * Math.PI) / 180);
  const turn = Math.atan2(eastward, to[1] - from[1]) / (Math.PI / 4);
  return POINTS[(Math.round(turn) + 8) % 8] as Compass;
}

/** A share in percent. Little is not nothing, and nearly all is not all. */
export function share(value: number | null | undefined): string {
  if (value === null || value === undefined || !Number.isFinite(value)) return UNKNOWN;
  if (value > 0 && value < 0.01) return `< ${number(1)} %`;
  if (value < 1 && value > 0.99) return `> ${number(99)} %`;
  return `${number(100 * value)} %`;
}

/** Whoever drives does not feel less, percent. */
const LEVEL = 1;

/** How many decimals a figure with this sigma deserves. */
export const decimalsOf = (sigma: number | null) => (sigma !== null && sigma < 0.095 ? 2 : 1);

/** "Rises 6.8 % ± 0.3 from A to B, towards the north-east"; within sigma of 0 it may as well be level. */
export function headline(slope: number | null, sigma: number | null, to: Compass): string {
  const towards = t(`segment.compass.${to}`);
  if (slope === null) return t("segment.unknown");
  const decimals = decimalsOf(sigma);
  const size = number(Math.abs(slope), decimals);
  const doubt = sigma === null ? "" : `\u00a0±\u00a0${number(sigma, decimals)}`;
  // Little, and surely little, is level; little and unsure is not.
  if (sigma !== null && Math.abs(slope) < sigma)
    return t(Math.abs(slope) + sigma < LEVEL ? "segment.level" : "segment.unsure", {
      slope: percent(slope, decimals),
      sigma: number(sigma, decimals),
      towards,
    });
  return t(slope < 0 ? "segment.falls" : "segment.rises", { slope: `${size} %${doubt}`, towards });
}

/** Slopes that differ by less are told alike. */
const SAME_PERCENT = 0.05;

/** What the elevation model says beside what was measured. */
export function besideModel(slope: number | null, model: number | null, measured: boolean): string {
  if (model === null) return t("segment.no_model");
  if (slope === null) return t("segment.model_alone", { model: percent(model) });
  // Of two falls the lower number is the steeper one, so it is not said which is less.
  const steeper = Math.abs(model) - Math.abs(slope);
  const level = Math.min(Math.abs(model), Math.abs(slope)) < SAME_PERCENT;
  const key =
    Math.abs(slope - model) < SAME_PERCENT
      ? "same"
      : slope * model < 0 && !level
        ? "other_way"
        : steeper > 0
          ? "steeper"
          : "flatter";
  return t(`segment.model_${key}`, {
    model: percent(model),
    apart: number(Math.abs(steeper), 1),
    than: t(measured ? "segment.than_measured" : "segment.than_follows"),
  });
}

/** The steepest stretch and where it is. */
export function steepest(
  slope: number | null,
  from: number | null,
  to: number | null,
  length: number,
): string {
  if (slope === null) return t("segment.steepest_unknown");
  if (from === null || to === null || to - from >= length - 0.05)
    return t("segment.steepest_whole", { slope: percent(slope) });
  return t("segment.steepest_at", { slope: percent(slope), from: number(from), to: number(to) });
}

/** The class of a road as people call it; what has no name of ours stays as OpenStreetMap has it. */
export function roadClass(highway: string): string {
  const key = `segment.highway.${highway}`;
  return hasText(key) ? t(key) : highway.replaceAll("_", " ");
}

/** What else is to know of the road. */
export function kinds(road: { bridge: boolean; tunnel: boolean; oneway: number }): string[] {
  return [
    road.bridge ? t("segment.bridge") : "",
    road.tunnel ? t("segment.tunnel") : "",
    road.oneway === 1 ? t("segment.oneway_ab") : road.oneway === -1 ? t("segment.oneway_ba") : "",
  ].filter(Boolean);
}

/** What heights of the network refer to, as the service says it (`HEIGHT_DATUM`). */
const LOGGED = "mean sea level as the receivers logged it, or the datum of control points near these";

/** What heights refer to. */
export function datumText(datum: string): string {
  return datum === LOGGED ? t("segment.datum_logged") : t("segment.datum", { datum });
}
