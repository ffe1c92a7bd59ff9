import { describe, expect, it } from "vitest";
import { agreementOf, alignedByRoad, alignedByTime, pairsOf } from "./align";
import type { DriveSegment, Profile } from "./data";
import { resampled } from "./series";
import { kindsOf, rowAt, rowNear, runsOf, shares, stays } from "./stretches";

const DEGREE_M = 111_195;

/** A drive along the equator: each row (x of the place in metres, segment, forward). */
function drive(rows: [number, number | null, boolean | null][], start_s = 0): Profile {
  let driven = 0;
  const distance_m = rows.map(([x], row) => {
    if (row > 0) driven += Math.abs(x - (rows[row - 1]?.[0] ?? x));
    return driven;
  });
  const all = <T>(value: T) => rows.map(() => value);
  return {
    epochs: rows.length,
    distance_m,
    time_s: rows.map((_, row) => start_s + row),
    time: all(""),
    alt_m: rows.map(([x]) => 100 + 0.05 * x),
    alt_sigma_m: all(1),
    slope_percent: all(5),
    slope_sigma_percent: all(1),
    grade_percent: rows.map(([, , forward]) => (forward === false ? -5 : 5)),
    grade_sigma_percent: all(0.5),
    segment_id: rows.map(([, segment]) => segment),
    forward: rows.map(([, , forward]) => forward),
    gap: rows.map((_, row) => row === 0),
    has_gnss: all(true),
    lon_deg: rows.map(([x]) => x / DEGREE_M),
    lat_deg: all(0),
    dem_height_m: all(null),
  };
}

const first = drive([
  [0, 1, true],
  [10, 1, true],
  [20, 2, true],
  [30, 2, true],
  [40, 3, true],
]);

describe("by time", () => {
  it("places the rows of another method where the first one was at the time", () => {
    const other = drive(
      [
        [0, 1, true],
        [12, 1, true],
        [25, 2, true],
      ],
      0.5,
    );
    const aligned = alignedByTime(first, other);
    expect(aligned.along_m).toEqual([5, 15, 25]);
    expect(aligned.shared_m).toBe(20);
  });

  it("breaks at an interruption and leaves out what lies outside", () => {
    const other = drive(
      [
        [0, 1, true],
        [10, 1, true],
        [20, 2, true],
        [30, 2, true],
      ],
      2,
    );
    other.gap[1] = true;
    const aligned = alignedByTime(first, other);
    expect(aligned.along_m).toEqual([20, 30, 30, 40]);
    expect(aligned.height_m[1]).toBeNull();
  });
});

describe("by road", () => {
  it("places another drive at the same places of the segments that both drove", () => {
    // It came from elsewhere: 500 m on other roads before.
    const other = drive([
      [-500, 9, true],
      [15, 2, true],
      [22, 2, true],
      [27, 2, true],
      [60, 8, true],
    ]);
    const aligned = alignedByRoad(first, other);
    expect(aligned.along_m.map((m) => Math.round(m))).toEqual([15, 22, 27]);
    expect(aligned.shared_m).toBeCloseTo(20);
  });

  it("turns the grade of a drive against the direction", () => {
    const other = drive([
      [35, 2, false],
      [28, 2, false],
      [18, 2, false],
    ]);
    const aligned = alignedByRoad(first, other);
    expect(aligned.along_m.map((m) => Math.round(m))).toEqual([18, 28, 35]);
    expect(aligned.grade_percent).toEqual([5, 5, 5]);
  });

  it("has nothing where no segment is common, and a break between parts", () => {
    expect(
      alignedByRoad(
        first,
        drive([
          [0, 7, true],
          [9, 7, true],
        ]),
      ).along_m,
    ).toEqual([]);
    const other = drive([
      [2, 1, true],
      [8, 1, true],
      [41, 3, true],
    ]);
    const aligned = alignedByRoad(first, other);
    expect(aligned.height_m.filter((one) => one === null)).toHaveLength(1);
  });

  it("draws between its own places alone", () => {
    expect(resampled([10, 20, 20, 30], [1, 2, null, 4], [0, 10, 15, 25, 40])).toEqual([
      null,
      1,
      1.5,
      null,
      null,
    ]);
  });
});

describe("segments of both", () => {
  const segment = (id: number, slope: number | null, sigma: number): DriveSegment =>
    ({ id, properties: { slope_percent: slope, slope_sigma_percent: sigma } }) as DriveSegment;

  it("compares with both sigmas", () => {
    const pairs = pairsOf(
      [segment(1, 2, 0.3), segment(2, 1, 1), segment(3, null, 1)],
      [segment(1, 4, 0.4), segment(2, 1.5, 1), segment(3, 1, 1), segment(4, 1, 1)],
    );
    expect(pairs.map((pair) => pair.sigmas)).toEqual([4, expect.closeTo(0.354, 2)]);
    expect(agreementOf(pairs)).toMatchObject({ segments: 2, median: 1.25, within: 0.5 });
    expect(agreementOf([])).toBeNull();
  });
});

describe("stretches", () => {
  it("meet halfway, but not across an interruption", () => {
    const drives = drive([
      [0, 1, true],
      [10, 1, true],
      [20, null, null],
      [30, 2, true],
    ]);
    drives.gap[3] = true;
    expect(runsOf(drives, (row) => drives.segment_id[row]).map((run) => [run.from_m, run.to_m])).toEqual([
      [0, 15],
      [15, 20],
      [30, 30],
    ]);
    expect(stays(drives).map((stay) => stay.segment)).toEqual([1, 2]);
    expect(kindsOf(drives, new Set([2]))).toEqual(["matched", "matched", "unmatched", "contradicts"]);
    expect(shares(drives, kindsOf(drives, new Set())).unmatched).toBeCloseTo(0.25);
  });

  it("finds rows", () => {
    expect([-5, 4, 6, 99].map((at) => rowAt([0, 10, 20], at))).toEqual([0, 0, 1, 2]);
    expect(rowAt([], 1)).toBe(-1);
    expect(rowNear(first, 21 / DEGREE_M, 0, 1e-4, null)).toBe(2);
    expect(rowNear(first, 1, 1, 1e-4, null)).toBeNull();
  });

  it("stays on the passage where one was", () => {
    const twice = drive([
      [0, 1, true],
      [10, 1, true],
      [20, 1, true],
      [10, 1, false],
      [0, 1, false],
    ]);
    expect(rowNear(twice, 10 / DEGREE_M, 0, 1e-4, 4)).toBe(3);
    expect(rowNear(twice, 10 / DEGREE_M, 0, 1e-4, 0)).toBe(1);
  });
});
