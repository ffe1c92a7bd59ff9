import { expect, test, vi } from "vitest";

vi.mock("../shared/texts", () => ({ t: (key: string) => key }));
const { growthSeries, stageSeries, throughputSeries } = await import("./parts/series");

const none = { waited_p50_s: null, computed_p50_s: null, published_p50_s: null, km: 0 };

test("days on which nothing ended had none", () => {
  const rows = [
    { at: "2026-11-20T00:00:00Z", done: 3, failed: 0, ...none },
    { at: "2026-11-18T00:00:00Z", done: 0, failed: 2, ...none },
  ];
  const { times, lines } = throughputSeries(rows, 30, Date.parse("2026-11-21T09:00:00Z") / 1000);
  expect(times).toHaveLength(4);
  expect(lines.map((line) => line.values)).toEqual([
    [0, 0, 3, 0],
    [2, 0, 0, 0],
  ]);
  expect(stageSeries(rows).times).toHaveLength(1);
  expect(throughputSeries([], 30).times).toEqual([]);
});

test("classes grow on as they were on days without a row, and short ones are one line", () => {
  const rows = ["a", "b", "c", "d", "e", "f", "g"].map((highway, k) => ({
    day: "2026-11-18",
    highway,
    driven_km: 10 - k,
  }));
  rows.push({ day: "2026-11-20", highway: "a", driven_km: 12 });
  const { times, lines } = growthSeries(rows);
  expect(times).toHaveLength(2);
  expect(lines.map((line) => line.label)).toEqual(["a", "b", "c", "d", "e", "admin.coverage.others"]);
  expect(lines[0]?.values).toEqual([10, 12]);
  expect(lines[1]?.values).toEqual([9, 9]);
  expect(lines[5]?.values).toEqual([9, 9]);
});
