/** Figures as people read them, in the page's language. Unknown is a dash, never 0. */
import { currentLanguage, ownForm } from "./texts";

export const UNKNOWN = "–";

/** A number with so many decimals. */
export function number(value: number | null | undefined, decimals = 0): string {
  if (value === null || value === undefined || !Number.isFinite(value)) return UNKNOWN;
  return value.toLocaleString(currentLanguage(), {
    minimumFractionDigits: decimals,
    maximumFractionDigits: decimals,
    signDisplay: "negative",
  });
}

/** A slope with its sign. */
export function percent(value: number | null | undefined, decimals = 1): string {
  if (value === null || value === undefined || !Number.isFinite(value)) return UNKNOWN;
  const sign = value > 0 ? "+" : value < 0 ? "−" : "";
  return `${sign}${number(Math.abs(value), decimals)} %`;
}

/** A slope with its sigma. */
export function slope(value: number | null | undefined, sigma: number | null | undefined): string {
  if (value === null || value === undefined) return UNKNOWN;
  const decimals = sigma !== null && sigma !== undefined && sigma < 0.095 ? 2 : 1;
  const doubt = sigma === null || sigma === undefined ? "" : ` ± ${number(sigma, decimals)}`;
  return `${percent(value, decimals).replace(" %", "")}${doubt} %`;
}

/** A length: metres below a kilometre. */
export function distance(metres: number | null | undefined): string {
  if (metres === null || metres === undefined) return UNKNOWN;
  return metres < 1000 ? `${number(metres)} m` : `${number(metres / 1000, metres < 100_000 ? 1 : 0)} km`;
}

/** A size in bytes. */
export function size(bytes: number | null | undefined): string {
  if (bytes === null || bytes === undefined) return UNKNOWN;
  const units = ["B", "kB", "MB", "GB", "TB"];
  let step = 0;
  let value = bytes;
  while (value >= 999.5 && step < units.length - 1) {
    value /= 1000;
    step += 1;
  }
  return `${number(value, step > 0 && value < 10 ? 1 : 0)} ${units[step]}`;
}

/** A span of time. */
export function duration(seconds: number | null | undefined): string {
  if (seconds === null || seconds === undefined || !Number.isFinite(seconds)) return UNKNOWN;
  if (seconds < 60) return `${number(seconds, seconds < 10 ? 1 : 0)} s`;
  const minutes = Math.round(seconds / 60);
  if (minutes < 60) return `${minutes} min`;
  const hours = Math.floor(minutes / 60);
  return hours < 48 ? `${hours} h ${minutes % 60} min` : `${number(hours / 24, 1)} d`;
}

/** A day in UTC, such as `2026-11-20`, as the visitor's country writes it. */
export function dayText(day: string): string {
  return new Date(day).toLocaleDateString(ownForm(navigator.languages), {
    dateStyle: "medium",
    timeZone: "UTC",
  });
}

/** A moment in the visitor's own time zone. */
export function moment(at: string | null | undefined): string {
  if (!at) return UNKNOWN;
  return new Date(at).toLocaleString(ownForm(navigator.languages), {
    dateStyle: "medium",
    timeStyle: "short",
  });
}
