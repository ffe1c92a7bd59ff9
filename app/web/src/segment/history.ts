/** How a segment's slope came together: its drives by time, and their mean so far. */
import type { Observation } from "./data";

export interface History {
  /** Seconds since 1970, ascending. */
  at: number[];
  accepted: (number | null)[];
  rejected: (number | null)[];
  sigma: number[];
  /** Of the accepted ones, up to each, by the inverse of their variances. */
  mean: (number | null)[];
}

export function together(drives: readonly Observation[]): History {
  const sorted = [...drives].sort((a, b) => a.first_at.localeCompare(b.first_at));
  let weights = 0;
  let sum = 0;
  const mean = sorted.map((one) => {
    const weight = one.slope_sigma_percent > 0 ? one.slope_sigma_percent ** -2 : 0;
    if (one.accepted !== false) {
      weights += weight;
      sum += weight * one.slope_percent;
    }
    return weights > 0 ? sum / weights : null;
  });
  return {
    at: sorted.map((one) => Date.parse(one.first_at) / 1000),
    accepted: sorted.map((one) => (one.accepted === false ? null : one.slope_percent)),
    rejected: sorted.map((one) => (one.accepted === false ? one.slope_percent : null)),
    sigma: sorted.map((one) => one.slope_sigma_percent),
    mean,
  };
}
