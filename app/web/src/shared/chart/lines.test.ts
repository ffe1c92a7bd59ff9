import { expect, test, vi } from "vitest";
import { columnOf } from "./draw";
import { elapsed, known, type Line, nearest, place, spread, ticks, written } from "./lines";
import { zoomedRange } from "./moves";

const line = (more: Partial<Line> = {}): Line => ({
  label: "a",
  values: [1, null, Number.NaN],
  colour: "model",
  ...more,
});

test("unknown is a dash and never 0", () => {
  expect(known([0, null, Number.NaN], 0)).toBe(0);
  expect([1, 2, 3].map((n) => known([0, null, Number.NaN], n))).toEqual([null, null, null]);
  expect([0, 1, 2].map((n) => written(line({ unit: "m", sigma: [0.25, 1, 1] }), n))).toEqual([
    "1.0 ± 0.3 m",
    "–",
    "–",
  ]);
});

test("the nearest place", () => {
  expect([-1, 0, 4, 6, 99].map((at) => nearest([0, 5, 10], at))).toEqual([0, 0, 1, 1, 2]);
});

test("rows of a table hold both ends", () => {
  expect(spread(0, 100, 3)).toEqual([0, 50, 100]);
  expect(spread(2, 4, 40)).toEqual([2, 3, 4]);
  expect(spread(3, 3, 40)).toEqual([3]);
});

test("a band takes two columns more", () => {
  const lines = [line({ sigma: [1] }), line({ sigma: [1], points: true }), line()];
  expect([0, 1, 2, 3].map((n) => columnOf(lines, n))).toEqual([1, 4, 5, 6]);
});

test("ticks are never rounded to what they are not", () => {
  expect(ticks("distance", [0, 2.5, 5], 5)).toEqual(["0.0 m", "2.5 m", "5.0 m"]);
  expect(ticks("distance", [1000, 1250, 1500], 500)).toEqual(["1.00 km", "1.25 km", "1.50 km"]);
});

test("ticks by what the axis counts", () => {
  expect(elapsed(3725)).toBe("1:02:05");
  expect(ticks("distance", [0, 50, 100], 100)).toEqual(["0 m", "50 m", "100 m"]);
  expect(ticks("distance", [0, 1000, 2000], 2000)).toEqual(["0 m", "1 km", "2 km"]);
});

test("zoom stays inside and ends at all", () => {
  expect(zoomedRange([0, 100], null, 10, 0.5)).toEqual([5, 55]);
  expect(zoomedRange([0, 100], null, null, 0.5)).toEqual([25, 75]);
  expect(zoomedRange([0, 100], [25, 75], null, 2)).toBeNull();
  expect(zoomedRange([0, 100], [60, 100], 61, 1, 0.5)).toEqual([60, 100]);
  expect(zoomedRange([0, 100], [0, 40], null, 1, 0.5)).toEqual([20, 60]);
});

test("a day has no hours, wherever the visitor is, and is written as there", () => {
  const at = Date.parse("2026-11-20T00:00:00Z") / 1000;
  vi.stubGlobal("navigator", { languages: ["en-GB"] });
  expect(place("day", at)).toBe("20 Nov 2026");
  expect(ticks("day", [at, at + 86_400], 86_400)).toEqual(["20 Nov", "21 Nov"]);
  vi.stubGlobal("navigator", { languages: ["en-US"] });
  expect(place("day", at)).toBe("Nov 20, 2026");
  expect(ticks("day", [at, at + 86_400], 86_400)).toEqual(["Nov 20", "Nov 21"]);
});
